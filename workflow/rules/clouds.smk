# Clouds: sampled or scanned points, cropped and scaled, with normals; and their true points.
rule sample:
    input:
        scene=lambda w: clouds.scene_file(w.dataset, w.cloud),
        about=lambda w: clouds.scene_file(w.dataset, w.cloud, "json"),
        made_by=made_by("samples/{dataset}/{cloud}", lambda w: clouds.sample(w.dataset, w.cloud)),
    output:
        cloud=f"{RESULTS}/samples/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/samples/{{dataset}}/{{cloud}}.json",
    log:
        f"{RESULTS}/logs/samples/{{dataset}}/{{cloud}}.log",
    priority: 1
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=lambda w, attempt: attempt * clouds.memory_mb(w.dataset),
        runtime=10,
    params:
        record=record_of(lambda w: clouds.sample(w.dataset, w.cloud)),
        code=code_of(lambda w: clouds.sample(w.dataset, w.cloud)),
    shell:
        "python -m puckbench.jobs sample {params.record} mesh={input.scene:q} cloud={output.cloud:q} > {log:q} 2>&1"


rule prepare:
    input:
        unpack(lambda w: clouds.sources(w.dataset, w.cloud)),
        about=lambda w: clouds.scene_file(w.dataset, w.cloud, "json"),
        made_by=made_by("clouds/{dataset}/{cloud}", lambda w: clouds.prepare(w.dataset)),
    output:
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.json",
        truth=f"{RESULTS}/truth/{{dataset}}/{{cloud}}.ply",
        truth_about=f"{RESULTS}/truth/{{dataset}}/{{cloud}}.json",
    log:
        f"{RESULTS}/logs/clouds/{{dataset}}/{{cloud}}.log",
    wildcard_constraints:
        dataset=one_of(clouds.prepared(has_returns=False)),
    priority: 1
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=lambda w, attempt: attempt * clouds.memory_mb(w.dataset),
        runtime=10,
    params:
        record=record_of(lambda w: clouds.prepare(w.dataset)),
        code=code_of(lambda w: clouds.prepare(w.dataset)),
        box=lambda w, input: f"box={shlex.quote(input.about)}" if clouds.is_cropped(w.dataset) else "",
    shell:
        "python -m puckbench.jobs prepare {params.record} source={input.source:q} cloud={output.cloud:q}"
        " truth={output.truth:q} about={input.about:q} {params.box} > {log:q} 2>&1"


# Clouds in metres with a sensor's returns, virtual or real, in the frame of the sensor.
rule prepare_returns:
    input:
        source=lambda w: clouds.source(w.dataset, w.cloud),
        about=lambda w: clouds.scene_file(w.dataset, w.cloud, "json"),
        made_by=made_by("clouds/{dataset}/{cloud}", lambda w: clouds.prepare(w.dataset)),
    output:
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.json",
        returns=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.parquet",
        truth=f"{RESULTS}/truth/{{dataset}}/{{cloud}}.ply",
        truth_about=f"{RESULTS}/truth/{{dataset}}/{{cloud}}.json",
    log:
        f"{RESULTS}/logs/clouds/{{dataset}}/{{cloud}}.log",
    wildcard_constraints:
        dataset=one_of(clouds.prepared(has_returns=True)),
    priority: 1
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=lambda w, attempt: attempt * clouds.memory_mb(w.dataset),
        runtime=10,
    params:
        record=record_of(lambda w: clouds.prepare(w.dataset)),
        code=code_of(lambda w: clouds.prepare(w.dataset)),
    shell:
        "python -m puckbench.jobs prepare_returns {params.record} source={input.source:q} cloud={output.cloud:q}"
        " returns={output.returns:q} truth={output.truth:q} about={input.about:q} > {log:q} 2>&1"
