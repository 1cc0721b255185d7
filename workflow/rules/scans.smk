# Scans: the table of all returns of the virtual sensor, clean and noisy.
rule scan:
    input:
        scene=lambda wildcards: bench.scene_file(wildcards.dataset, wildcards.cloud),
        about=lambda wildcards: bench.scene_file(wildcards.dataset, wildcards.cloud, "json"),
    output:
        f"{RESULTS}/scans/{{dataset}}/{{cloud}}.parquet",
    params:
        arguments=lambda wildcards: bench.scan_arguments(wildcards.dataset),
        code=lambda wildcards: bench.scan_code(wildcards.dataset),
    resources:
        mem_mb=lambda wildcards: bench.memory_mb(wildcards.dataset),
        runtime=10,
    log:
        f"{RESULTS}/logs/scans/{{dataset}}/{{cloud}}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench scan {input.scene} {output}"
        " {params.arguments} > {log} 2>&1"
