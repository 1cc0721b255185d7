# Metrics: a result row for each cloud, codec and rate, from the streams' bytes alone; a job makes
# those of a whole curve. Where scenes are labelled, a codec of surfaces has its primitives compared
# with those that the scene is made of.
for curve in coding.curves:
    for surfaces in (False, True):
        if not (measured := coding.measured(curve, surfaces)):
            continue
        recovered = {"recovered": curve.files(f"{RESULTS}/recovery", ".json")} if surfaces else {}

        rule:
            name:
                curve.name("evaluate") + ("_surfaces" if surfaces else "")
            input:
                curve.first(f"{RESULTS}/coded", ".bin"),
                unpack(lambda w: coding.truth(w.dataset, w.cloud)),
                unpack(
                    lambda w, surfaces=surfaces: (
                        coding.labels(w.dataset, w.cloud) if surfaces else {}
                    )
                ),
                cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
            output:
                **recovered,
                rows=curve.files(f"{RESULTS}/metrics", ".json"),
            log:
                f"{RESULTS}/logs/metrics/{{dataset}}/{{cloud}}/{curve.log}.log",
            wildcard_constraints:
                dataset=one_of(measured),
            priority: priority_of(curve)
            conda:
                "../../envs/puckbench.yaml"
            threads: coding.cores(CORES)
            resources:
                mem_mb=lambda w, attempt, mb=coding.memory_mb(curve.codec): attempt * mb,
                runtime=lambda w, attempt, minutes=coding.minutes(curve): attempt * minutes,
            params:
                job="evaluate_surfaces" if surfaces else "evaluate_curve",
                record=lambda w, c=curve, surfaces=surfaces: coding.evaluate(
                    w.dataset, c, surfaces
                ).record,
                code=lambda w, c=curve, surfaces=surfaces: coding.evaluate(
                    w.dataset, c, surfaces
                ).code,
                files=lambda w, input, output: files_of(input, output),
                streams=curve.files(f"{RESULTS}/coded", ".bin"),
                timed=coding.threads_environment,
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
