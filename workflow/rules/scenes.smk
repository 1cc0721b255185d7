# Scenes: meshes (some with labels) or captured clouds, in metres, z up.
scene = rules_of("scene", "scenes/{scene_set}/{scene}")


rule scene:
    input:
        unpack(scene.inputs),
    output:
        scene=f"{RESULTS}/scenes/{{scene_set}}/{{scene}}.ply",
        about=f"{RESULTS}/scenes/{{scene_set}}/{{scene}}.json",
    log:
        scene.log,
    wildcard_constraints:
        scene_set=one_of(set(plan.scene_sets) - set(flow.files.of_returns)),
    priority: priority_of
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=scene.memory_mb,
        runtime=scene.minutes,
    params:
        settings=scene.settings,
        key=scene.key,
    shell:
        "python -m puckbench.steps scene {params.settings} scene={output.scene:q} --key={params.key} > {log:q} 2>&1"


# Returns of real sensors, in the frame of the sensor.
use rule scene as scene_of_returns with:
    output:
        scene=f"{RESULTS}/scenes/{{scene_set}}/{{scene}}.parquet",
        about=f"{RESULTS}/scenes/{{scene_set}}/{{scene}}.json",
    wildcard_constraints:
        scene_set=one_of(flow.files.of_returns),
