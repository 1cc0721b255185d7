# Clouds: sampled or scanned points, cropped, with normals, scaled; and the true points beside them.
rule sample:
    input:
        scene=lambda wildcards: bench.scene_file(wildcards.dataset, wildcards.cloud),
    output:
        cloud=f"{RESULTS}/samples/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/samples/{{dataset}}/{{cloud}}.json",
    params:
        points=lambda wildcards: bench.dataset(wildcards.dataset).settings["points"],
        seed=lambda wildcards: bench.dataset(wildcards.dataset).seed,
        code=code_version("puckbench.cli.sample"),
    resources:
        mem_mb=lambda wildcards: bench.memory_mb(wildcards.dataset),
        runtime=10,
    log:
        f"{RESULTS}/logs/samples/{{dataset}}/{{cloud}}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench sample {input.scene} {output.cloud}"
        " --points {params.points} --seed {params.seed} > {log} 2>&1"


rule prepare:
    input:
        source=lambda wildcards: bench.source(wildcards.dataset, wildcards.cloud),
        about=lambda wildcards: bench.scene_file(wildcards.dataset, wildcards.cloud, "json"),
    output:
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.json",
        truth=f"{RESULTS}/truth/{{dataset}}/{{cloud}}.ply",
        truth_about=f"{RESULTS}/truth/{{dataset}}/{{cloud}}.json",
    params:
        crop=lambda wildcards: bench.crop_arguments(wildcards.dataset, wildcards.cloud),
        size=lambda wildcards: bench.dataset(wildcards.dataset).settings["size"],
        neighbours=lambda wildcards: bench.dataset(wildcards.dataset).settings["neighbours"],
        code=code_version("puckbench.cli.prepare"),
    resources:
        mem_mb=lambda wildcards: bench.memory_mb(wildcards.dataset),
        runtime=10,
    log:
        f"{RESULTS}/logs/clouds/{{dataset}}/{{cloud}}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench prepare {input.source} {output.cloud} --truth {output.truth}"
        " --about {input.about} {params.crop} --scale {params.size}"
        " --neighbours {params.neighbours} > {log} 2>&1"
