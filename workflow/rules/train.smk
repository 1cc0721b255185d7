# Weights of learned codecs, trained on prepared clouds. A killed training resumes from its checkpoint,
# unless code, settings or clouds have changed.
rule weights:
    input:
        clouds=lambda w: training.cloud_files(plan.trainings[w.trained].clouds),
        validate=lambda w: training.cloud_files(plan.trainings[w.trained].validate),
        about=lambda w: training.descriptions(w.trained),
        start=lambda w: ancient(training.given_start(w.trained))
        or plan.trainings[w.trained].start
        or [],
        made_by=made_by("weights/{trained}", lambda w: training.train(w.trained)),
    output:
        weights=f"{RESULTS}/weights/{{trained}}.safetensors",
        curve=f"{RESULTS}/weights/{{trained}}.csv",
        card=f"{RESULTS}/weights/{{trained}}.json",
    log:
        f"{RESULTS}/logs/weights/{{trained}}.log",
    conda:
        "../../envs/puckbench.yaml"
    threads: 64  # or all cores: one training at a time
    resources:
        mem_mb=lambda w: training.memory_mb(w.trained),
        runtime=24 * 60,
    params:
        record=record_of(lambda w: training.train(w.trained)),
        code=code_of(lambda w: training.train(w.trained)),
    shell:
        "python -m puckbench.jobs train {params.record} clouds={input.clouds:q} weights={output.weights:q}"
        " validate={input.validate:q} > {log:q} 2>&1"


TRAINED = [
    f"{RESULTS}/weights/{name}.{suffix}"
    for name in plan.trainings
    for suffix in ("safetensors", "csv", "json")
]
