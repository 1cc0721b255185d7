# Metrics: a table with a result row for each rate of a curve, from the bytes of its streams.
rule evaluate:
    input:
        unpack(lambda w: coding.cloud(w.dataset, w.cloud)),
        unpack(lambda w: coding.described(coding.truth(w.dataset, w.cloud))),
        curve=f"{RESULTS}/coded/{{dataset}}/{{cloud}}/{{codec}}.zip",
        made_by=made_by(
            "metrics/{dataset}/{cloud}/{codec}", lambda w: coding.evaluate(*curve_of(w))
        ),
    output:
        f"{RESULTS}/metrics/{{dataset}}/{{cloud}}/{{codec}}.parquet",
    log:
        f"{RESULTS}/logs/metrics/{{dataset}}/{{cloud}}/{{codec}}.log",
    priority: priority_of
    conda:
        "../../envs/puckbench.yaml"
    threads: coding.cores(CORES)
    resources:
        mem_mb=lambda w, attempt: attempt * coding.memory_mb(w.codec),
        runtime=lambda w, attempt: attempt * coding.minutes(w.codec),
    params:
        record=record_of(lambda w: coding.evaluate(*curve_of(w))),
        code=code_of(lambda w: coding.evaluate(*curve_of(w))),
        truth=lambda w, input: files_of(input, coding.truth(w.dataset, w.cloud)),
        timed=TIMED,
    shell:
        "{params.timed} python -m puckbench.jobs evaluate_curve {params.record} cloud={input.cloud:q}"
        " curve={input.curve:q} rows={output:q} {params.truth} > {log:q} 2>&1"


# Primitives of decoded surfaces, compared with the labels of the scene.
rule recovery:
    input:
        unpack(lambda w: coding.described(coding.labels(w.dataset, w.cloud))),
        curve=f"{RESULTS}/coded/{{dataset}}/{{cloud}}/{{codec}}.zip",
        made_by=made_by(
            "recovery/{dataset}/{cloud}/{codec}", lambda w: coding.recovery(w.dataset, w.codec)
        ),
    output:
        f"{RESULTS}/recovery/{{dataset}}/{{cloud}}/{{codec}}.parquet",
    log:
        f"{RESULTS}/logs/recovery/{{dataset}}/{{cloud}}/{{codec}}.log",
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=lambda w, attempt: attempt * coding.memory_mb(w.codec),
        runtime=lambda w, attempt: attempt * coding.minutes(w.codec),
    params:
        record=record_of(lambda w: coding.recovery(w.dataset, w.codec)),
        code=code_of(lambda w: coding.recovery(w.dataset, w.codec)),
    shell:
        "python -m puckbench.jobs recovery_curve {params.record} curve={input.curve:q} points={input.points:q}"
        " scene={input.scene:q} rows={output:q} > {log:q} 2>&1"


# Errors of a scan itself, measured as if it were a decoded cloud.
rule scan_error:
    input:
        unpack(lambda w: coding.described(coding.truth(w.dataset, w.cloud))),
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.json",
        made_by=made_by("scan_errors/{dataset}/{cloud}", lambda w: coding.scan_error(w.dataset)),
    output:
        f"{RESULTS}/scan_errors/{{dataset}}/{{cloud}}.json",
    log:
        f"{RESULTS}/logs/scan_errors/{{dataset}}/{{cloud}}.log",
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=lambda w, attempt: attempt * clouds.memory_mb(w.dataset),
        runtime=30,
    params:
        record=record_of(lambda w: coding.scan_error(w.dataset)),
        code=code_of(lambda w: coding.scan_error(w.dataset)),
        truth=lambda w, input: files_of(input, coding.truth(w.dataset, w.cloud)),
    shell:
        "python -m puckbench.jobs evaluate {params.record} cloud={input.cloud:q} decoded={input.cloud:q}"
        " row={output:q} {params.truth} > {log:q} 2>&1"
