# Metrics: a result row for each cloud, codec and rate, from the stream's bytes alone.
rule evaluate:
    input:
        unpack(lambda wildcards: bench.evaluated(wildcards.dataset, wildcards.cloud)),
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        stream=f"{RESULTS}/coded/{CELL}.bin",
    output:
        f"{RESULTS}/metrics/{CELL}.json",
    params:
        arguments=lambda wildcards: bench.evaluate_arguments(
            wildcards.dataset, wildcards.cloud, wildcards.codec, wildcards.rate
        ),
        code=lambda wildcards: bench.codec_code("puckbench.cli.evaluate", wildcards.codec),
    threads: bench.timed_cores(workflow.cores)
    resources:
        mem_mb=bench.cell_memory_mb,
        runtime=30,
    log:
        f"{RESULTS}/logs/metrics/{CELL}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        bench.timed + " python -m puckbench evaluate {input.cloud} {input.stream} --row {output}"
        " {params.arguments} > {log} 2>&1"
