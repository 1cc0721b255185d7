# Codecs: one self-contained stream for each cloud, codec and rate; decoded clouds when asked for.
CELL = "{dataset}/{cloud}/{codec}/{rate}"


# What is made together is followed by one of its files: there are tens of thousands of these jobs,
# and planning pays for each input of each.
rule encode:
    input:
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
    output:
        stream=f"{RESULTS}/coded/{CELL}.bin",
        record=f"{RESULTS}/coded/{CELL}.bin.json",
    params:
        arguments=lambda wildcards: bench.encode_arguments(wildcards.codec, wildcards.rate),
        timed=bench.timed,
        code=lambda wildcards: bench.codec_code("puckbench.cli.encode", wildcards.codec),
    threads: bench.timed_cores(workflow.cores)
    resources:
        mem_mb=bench.cell_memory_mb,
        runtime=30,
    log:
        f"{RESULTS}/logs/coded/{CELL}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "{params.timed} python -m puckbench encode {input.cloud} {output.stream}"
        " {params.arguments} > {log} 2>&1"


rule decode:
    input:
        stream=f"{RESULTS}/coded/{CELL}.bin",
    output:
        cloud=f"{RESULTS}/decoded/{CELL}.ply",
        about=f"{RESULTS}/decoded/{CELL}.json",
    params:
        entry=lambda wildcards: bench.codec_entry(wildcards.codec, wildcards.rate),
        code=lambda wildcards: bench.codec_code("puckbench.cli.decode", wildcards.codec),
    resources:
        mem_mb=lambda wildcards: bench.memory_mb(wildcards.dataset),
        runtime=30,
    log:
        f"{RESULTS}/logs/decoded/{CELL}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench decode {input.stream} {output.cloud} --codec {wildcards.codec}"
        " --entry {params.entry:q} > {log} 2>&1"
