# Metrics: a result row for each cloud, codec and rate, from the streams' bytes alone; a job makes
# those of a whole curve. Where scenes are labelled, a codec of surfaces has its primitives compared
# with those that the scene is made of. A cloud that the report shows has its own rules, without
# wildcards, which Snakemake prefers: their jobs write some decoded clouds as well.
for measuring in coding.measuring:

    rule:
        name:
            measuring.name
        input:
            *measuring.of(measuring.curve.first(f"{RESULTS}/coded", ".bin")),
            unpack(lambda w, one=measuring: coding.truth(*one.place(w))),
            unpack(lambda w, one=measuring: coding.labels(*one.place(w)) if one.surfaces else {}),
            cloud=measuring.of(f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply"),
        output:
            *measuring.beside(RESULTS),
            **measuring.outputs(RESULTS),
        log:
            measuring.of(f"{RESULTS}/logs/metrics/{{dataset}}/{{cloud}}/{measuring.curve.log}.log"),
        wildcard_constraints:
            dataset=one_of(measuring.datasets),
        priority: priority_of(measuring.curve)
        conda:
            "../../envs/puckbench.yaml"
        threads: coding.cores(CORES)
        resources:
            mem_mb=lambda w, attempt, mb=coding.memory_mb(measuring.curve.codec): attempt * mb,
            runtime=lambda w, attempt, minutes=coding.minutes(measuring.curve): attempt * minutes,
        params:
            job="evaluate_surfaces" if measuring.surfaces else "evaluate_curve",
            record=lambda w, one=measuring: coding.evaluate(*one.job(w)).record,
            code=lambda w, one=measuring: coding.evaluate(*one.job(w)).code,
            files=lambda w, input, output: files_of(input, output),
            streams=measuring.of(*measuring.curve.files(f"{RESULTS}/coded", ".bin")),
            timed=TIMED,
        shell:
            "{params.timed} python -m puckbench.jobs {params.job} {params.record:q} {params.files}"
            " streams={params.streams:q} > {log:q} 2>&1"


# A scan measured as if it had been decoded: what of the truth it lacks before any codec.
rule scan_error:
    input:
        unpack(lambda w: coding.truth(w.dataset, w.cloud)),
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.json",
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
        record=lambda w: coding.scan_error(w.dataset).record,
        code=lambda w: coding.scan_error(w.dataset).code,
        truth=lambda w: files_of(coding.truth(w.dataset, w.cloud)),
    shell:
        "python -m puckbench.jobs evaluate {params.record:q} cloud={input.cloud:q} decoded={input.cloud:q}"
        " row={output:q} {params.truth} > {log:q} 2>&1"
