# Clouds: sampled or scanned points, cropped and scaled, with normals; and their true points.
sample = rules_of("sample", "samples/{dataset}/{cloud}")


rule sample:
    input:
        unpack(sample.inputs),
    output:
        cloud=f"{RESULTS}/samples/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/samples/{{dataset}}/{{cloud}}.json",
    log:
        sample.log,
    priority: priority_of
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=sample.memory_mb,
        runtime=sample.minutes,
    params:
        settings=sample.settings,
        key=sample.key,
    shell:
        "python -m puckbench.steps sample {params.settings} mesh={input.scene:q}"
        " cloud={output.cloud:q} --key={params.key} > {log:q} 2>&1"


prepare = rules_of("prepare", "clouds/{dataset}/{cloud}")


rule prepare:
    input:
        unpack(prepare.inputs),
    output:
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.json",
        truth=f"{RESULTS}/truth/{{dataset}}/{{cloud}}.ply",
        truth_about=f"{RESULTS}/truth/{{dataset}}/{{cloud}}.json",
    log:
        prepare.log,
    wildcard_constraints:
        dataset=one_of(flow.files.prepared(has_returns=False)),
    priority: priority_of
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=prepare.memory_mb,
        runtime=prepare.minutes,
    params:
        settings=prepare.settings,
        key=prepare.key,
    shell:
        "python -m puckbench.steps prepare {params.settings} source={input.source:q}"
        " about={input.about:q} cloud={output.cloud:q} truth={output.truth:q}"
        " --key={params.key} > {log:q} 2>&1"


# Clouds in metres with a sensor's returns, virtual or real, in the frame of the sensor.
prepare_returns = rules_of("prepare_returns", "clouds/{dataset}/{cloud}")


rule prepare_returns:
    input:
        unpack(prepare_returns.inputs),
    output:
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.json",
        returns=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.parquet",
        truth=f"{RESULTS}/truth/{{dataset}}/{{cloud}}.ply",
        truth_about=f"{RESULTS}/truth/{{dataset}}/{{cloud}}.json",
    log:
        prepare_returns.log,
    wildcard_constraints:
        dataset=one_of(flow.files.prepared(has_returns=True)),
    priority: priority_of
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=prepare_returns.memory_mb,
        runtime=prepare_returns.minutes,
    params:
        settings=prepare_returns.settings,
        key=prepare_returns.key,
    shell:
        "python -m puckbench.steps prepare_returns {params.settings} source={input.source:q}"
        " about={input.about:q} cloud={output.cloud:q} returns={output.returns:q}"
        " truth={output.truth:q} --key={params.key} > {log:q} 2>&1"
