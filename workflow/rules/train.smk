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


TRAINED = [
    f"{RESULTS}/weights/{name}.{suffix}"
    for name in plan.trainings
    for suffix in ("safetensors", "csv", "json")
]
