# Scenes: meshes (with labels where there are any) or captured clouds, in metres, z up.
rule scene:
    input:
        lambda wildcards: bench.plan.scenes[wildcards.scenes].files(wildcards.scene),
    output:
        scene=f"{RESULTS}/scenes/{{scenes}}/{{scene}}.ply",
        about=f"{RESULTS}/scenes/{{scenes}}/{{scene}}.json",
    params:
        loader=lambda wildcards: bench.scene_parameters(wildcards.scenes)["loader"],
        options=lambda wildcards: bench.scene_parameters(wildcards.scenes)["options"],
        seed=lambda wildcards: bench.scene_parameters(wildcards.scenes)["seed"],
        code=lambda wildcards: bench.scene_parameters(wildcards.scenes)["code"],
    resources:
        mem_mb=2000,
        runtime=10,
    log:
        f"{RESULTS}/logs/scenes/{{scenes}}/{{scene}}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench scene {params.loader} {wildcards.scene} {output.scene}"
        " --options {params.options:q} --seed {params.seed} > {log} 2>&1"
