# Codecs: self-contained streams, one for each cloud, codec and rate; decoded clouds when asked for.
# A job makes the streams of a whole rate-distortion curve, or of a part where that takes long, and
# beside each a record of what it cost. What follows them follows the first: they are made together.
for curve in coding.curves:

    rule:
        name:
            curve.name("encode")
        input:
            cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        output:
            streams=curve.files(f"{RESULTS}/coded", ".bin"),
        log:
            f"{RESULTS}/logs/coded/{{dataset}}/{{cloud}}/{curve.log}.log",
        wildcard_constraints:
            dataset=one_of(coding.datasets(curve)),
        priority: priority_of(curve)
        conda:
            "../../envs/puckbench.yaml"
        threads: coding.cores(CORES)
        resources:
            mem_mb=lambda w, attempt, mb=coding.memory_mb(curve.codec): attempt * mb,
            runtime=lambda w, attempt, minutes=coding.minutes(curve): attempt * minutes,
        params:
            record=coding.encode(curve).record,
            code=coding.encode(curve).code,
            timed=TIMED,
        shell:
            "{params.timed} python -m puckbench.jobs encode_curve {params.record:q} cloud={input.cloud:q}"
            " streams={output.streams:q} > {log:q} 2>&1"


# Each rate alone; those that the report shows are written where they are measured.
for curve in coding.curves:
    for rate in curve.alone():

        rule:
            name:
                rate.name("decode")
            input:
                curve.first(f"{RESULTS}/coded", ".bin"),
            output:
                cloud=rate.first(f"{RESULTS}/decoded", ".ply"),
                about=rate.first(f"{RESULTS}/decoded", ".json"),
            log:
                f"{RESULTS}/logs/decoded/{{dataset}}/{{cloud}}/{rate.log}.log",
            wildcard_constraints:
                dataset=one_of(coding.datasets(curve)),
            conda:
                "../../envs/puckbench.yaml"
            resources:
                mem_mb=lambda w, attempt, mb=coding.memory_mb(curve.codec): attempt * mb,
                runtime=lambda w, attempt, minutes=coding.minutes(rate): attempt * minutes,
            params:
                record=coding.decode(rate).record,
                code=coding.decode(rate).code,
                stream=rate.files(f"{RESULTS}/coded", ".bin"),
            shell:
                "python -m puckbench.jobs decode {params.record:q} stream={params.stream:q}"
                " cloud={output.cloud:q} > {log:q} 2>&1"
