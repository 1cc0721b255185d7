# Scenes: meshes (some with labels) or captured clouds, in metres, z up.
rule scene:
    input:
        planned(lambda w: ancient(plan.scene_sets[w.scene_set].files(w.scene))),
        made_by=made_by("scenes/{scene_set}/{scene}", lambda w: clouds.scene(w.scene_set, w.scene)),
    output:
        scene=f"{RESULTS}/scenes/{{scene_set}}/{{scene}}.ply",
        about=f"{RESULTS}/scenes/{{scene_set}}/{{scene}}.json",
    log:
        f"{RESULTS}/logs/scenes/{{scene_set}}/{{scene}}.log",
    wildcard_constraints:
        scene_set=one_of(set(plan.scene_sets) - set(clouds.of_returns)),
    priority: 1
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        record=record_of(lambda w: clouds.scene(w.scene_set, w.scene)),
        code=code_of(lambda w: clouds.scene(w.scene_set, w.scene)),
    shell:
        "python -m puckbench.jobs scene {params.record} scene={output.scene:q} > {log:q} 2>&1"


# Returns of real sensors, in the frame of the sensor.
use rule scene as scene_of_returns with:
    output:
        scene=f"{RESULTS}/scenes/{{scene_set}}/{{scene}}.parquet",
        about=f"{RESULTS}/scenes/{{scene_set}}/{{scene}}.json",
    wildcard_constraints:
        scene_set=one_of(clouds.of_returns),
