# Scenes: meshes (some with labels) or captured clouds, in metres, z up.
rule scene:
    input:
        planned(lambda w: ancient(plan.scenes[w.scenes].files(w.scene))),
        made_by=made_by("scenes/{scenes}/{scene}", lambda w: clouds.scene(w.scenes, w.scene)),
    output:
        scene=f"{RESULTS}/scenes/{{scenes}}/{{scene}}.ply",
        about=f"{RESULTS}/scenes/{{scenes}}/{{scene}}.json",
    log:
        f"{RESULTS}/logs/scenes/{{scenes}}/{{scene}}.log",
    wildcard_constraints:
        scenes=one_of(set(plan.scenes) - set(clouds.of_returns)),
    priority: 1
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        record=record_of(lambda w: clouds.scene(w.scenes, w.scene)),
        code=code_of(lambda w: clouds.scene(w.scenes, w.scene)),
    shell:
        "python -m puckbench.jobs scene {params.record} scene={output.scene:q} > {log:q} 2>&1"


# Returns of real sensors, in the frame of the sensor.
use rule scene as scene_of_returns with:
    output:
        scene=f"{RESULTS}/scenes/{{scenes}}/{{scene}}.parquet",
        about=f"{RESULTS}/scenes/{{scenes}}/{{scene}}.json",
    wildcard_constraints:
        scenes=one_of(clouds.of_returns),
