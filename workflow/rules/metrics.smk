# Metrics: a table with a result row for each rate of a curve, from the bytes of its streams.
evaluate = rules_of("evaluate", "metrics/{dataset}/{cloud}/{codec}")


rule evaluate:
    input:
        unpack(evaluate.inputs),
    output:
        f"{RESULTS}/metrics/{{dataset}}/{{cloud}}/{{codec}}.parquet",
    log:
        evaluate.log,
    priority: priority_of
    conda:
        "../../envs/puckbench.yaml"
    threads: flow.costs.cores(CORES)
    resources:
        mem_mb=evaluate.memory_mb,
        runtime=evaluate.minutes,
    params:
        settings=evaluate.settings,
        key=evaluate.key,
        truth=lambda w, input: words_of(input, flow.files.truth(w.dataset, w.cloud)),
        timed=TIMED,
    shell:
        "{params.timed} python -m puckbench.steps evaluate {params.settings}"
        " cloud={input.cloud:q} curve={input.curve:q} rows={output:q} {params.truth}"
        " --key={params.key} > {log:q} 2>&1"


# Primitives of decoded surfaces, compared with the labels of the scene.
recovery = rules_of("recovery", "recovery/{dataset}/{cloud}/{codec}")


rule recovery:
    input:
        unpack(recovery.inputs),
    output:
        f"{RESULTS}/recovery/{{dataset}}/{{cloud}}/{{codec}}.parquet",
    log:
        recovery.log,
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=recovery.memory_mb,
        runtime=recovery.minutes,
    params:
        settings=recovery.settings,
        key=recovery.key,
    shell:
        "python -m puckbench.steps recovery {params.settings} curve={input.curve:q}"
        " points={input.points:q} scene={input.scene:q} rows={output:q}"
        " --key={params.key} > {log:q} 2>&1"


# Errors of a scan itself, measured as if it were a decoded cloud.
scan_error = rules_of("scan_error", "scan_errors/{dataset}/{cloud}")


rule scan_error:
    input:
        unpack(scan_error.inputs),
    output:
        f"{RESULTS}/scan_errors/{{dataset}}/{{cloud}}.json",
    log:
        scan_error.log,
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=scan_error.memory_mb,
        runtime=scan_error.minutes,
    params:
        settings=scan_error.settings,
        key=scan_error.key,
        truth=lambda w, input: words_of(input, flow.files.truth(w.dataset, w.cloud)),
    shell:
        "python -m puckbench.steps scan_error {params.settings} cloud={input.cloud:q}"
        " row={output:q} {params.truth} --key={params.key} > {log:q} 2>&1"
