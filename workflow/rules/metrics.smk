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
        timed=bench.timed,
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
        "{params.timed} python -m puckbench evaluate {input.cloud} {input.stream} --row {output}"
        " {params.arguments} > {log} 2>&1"


# A scan measured as if it had been decoded: what of the truth it lacks before any codec.
rule scan_error:
    input:
        unpack(lambda wildcards: bench.evaluated(wildcards.dataset, wildcards.cloud)),
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.json",
    output:
        f"{RESULTS}/scan_errors/{{dataset}}/{{cloud}}.json",
    params:
        truth=lambda wildcards, input: truth_arguments(input),
        code=code_version("puckbench.cli.evaluate"),
    resources:
        mem_mb=lambda wildcards: bench.memory_mb(wildcards.dataset),
        runtime=30,
    log:
        f"{RESULTS}/logs/scan_errors/{{dataset}}/{{cloud}}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench evaluate {input.cloud} {input.cloud} {params.truth}"
        " --dataset {wildcards.dataset} --row {output} > {log} 2>&1"


# Geometric primitives of a stream's surface against those that the scene is made of.
rule recovery:
    input:
        stream=f"{RESULTS}/coded/{CELL}.bin",
        record=f"{RESULTS}/coded/{CELL}.bin.json",
        points=lambda wildcards: bench.true_points(wildcards.dataset, wildcards.cloud),
        scene=lambda wildcards: bench.scene_file(wildcards.dataset, wildcards.cloud),
        about=lambda wildcards: bench.scene_file(wildcards.dataset, wildcards.cloud, "json"),
    output:
        f"{RESULTS}/recovery/{CELL}.json",
    params:
        entry=lambda wildcards: bench.codec_entry(wildcards.codec, wildcards.rate),
        code=lambda wildcards: bench.codec_code("puckbench.cli.recovery", wildcards.codec),
    resources:
        mem_mb=lambda wildcards: bench.memory_mb(wildcards.dataset),
        runtime=30,
    log:
        f"{RESULTS}/logs/recovery/{CELL}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench recovery {input.stream} {input.points} {input.scene}"
        " --dataset {wildcards.dataset} --codec {wildcards.codec} --entry {params.entry:q}"
        " --row {output} > {log} 2>&1"
