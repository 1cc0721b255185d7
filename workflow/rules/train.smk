# Weights of learned codecs, trained on prepared clouds. A killed training resumes from its checkpoint,
# unless code, settings or clouds have changed.
weights = rules_of("weights", "weights/{trained}")


rule weights:
    input:
        unpack(weights.inputs),
    output:
        weights=f"{RESULTS}/weights/{{trained}}.safetensors",
        curve=f"{RESULTS}/weights/{{trained}}.csv",
        card=f"{RESULTS}/weights/{{trained}}.json",
    log:
        weights.log,
    conda:
        "../../envs/puckbench.yaml"
    threads: 64  # or all cores: one training at a time
    resources:
        mem_mb=weights.memory_mb,
        runtime=weights.minutes,
    params:
        settings=weights.settings,
        key=weights.key,
    shell:
        "python -m puckbench.steps weights {params.settings} clouds={input.clouds:q}"
        " weights={output.weights:q} validate={input.validate:q} --key={params.key} > {log:q} 2>&1"


# Weights of networks of segmentation, trained on labelled clouds.
segmentation_weights = rules_of("segmentation_weights", "segmentation/{network}")


rule segmentation_weights:
    input:
        unpack(segmentation_weights.inputs),
    output:
        weights=f"{RESULTS}/segmentation/{{network}}.safetensors",
        curve=f"{RESULTS}/segmentation/{{network}}.csv",
        card=f"{RESULTS}/segmentation/{{network}}.json",
    log:
        segmentation_weights.log,
    conda:
        "../../envs/puckbench.yaml"
    threads: 1  # several trainings at a time
    resources:
        mem_mb=segmentation_weights.memory_mb,
        runtime=segmentation_weights.minutes,
    params:
        settings=segmentation_weights.settings,
        key=segmentation_weights.key,
    shell:
        "python -m puckbench.steps segmentation_weights {params.settings} clouds={input.clouds:q}"
        " weights={output.weights:q} validate={input.validate:q} --key={params.key} > {log:q} 2>&1"


TRAINED = [
    f"{RESULTS}/{folder}/{name}.{suffix}"
    for folder, names in (("weights", plan.trainings), ("segmentation", plan.segmentations))
    for name in names
    for suffix in ("safetensors", "csv", "json")
]
