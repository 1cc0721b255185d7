# Weights of learned codecs, trained on prepared clouds. A training that was killed goes on from its
# checkpoint; one that other code, settings or clouds began is begun anew.
rule weights:
    input:
        clouds=lambda wildcards: bench.cloud_files(bench.training(wildcards.trained).clouds),
        validate=lambda wildcards: bench.cloud_files(bench.training(wildcards.trained).validate),
        start=lambda wildcards: bench.training(wildcards.trained).start or [],
    output:
        weights=f"{RESULTS}/weights/{{trained}}.safetensors",
        curve=f"{RESULTS}/weights/{{trained}}.csv",
        card=f"{RESULTS}/weights/{{trained}}.json",
    params:
        arguments=lambda wildcards: bench.training_arguments(wildcards.trained),
        validate=lambda wildcards, input: f"--validate {input.validate}" if input.validate else "",
        start=lambda wildcards, input: f"--start {input.start}" if input.start else "",
        code=code_version("puckbench.cli.train"),
    threads: 64  # or all that there are: one training at a time
    resources:
        mem_mb=lambda wildcards: bench.training_memory_mb(wildcards.trained),
        runtime=24 * 60,
    log:
        f"{RESULTS}/logs/weights/{{trained}}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench train {input.clouds} --out {output.weights} {params.validate}"
        " {params.start} {params.arguments} > {log} 2>&1"


TRAINED = [
    f"{RESULTS}/weights/{name}.{suffix}"
    for name in bench.plan.trainings
    for suffix in ("safetensors", "csv", "json")
]
