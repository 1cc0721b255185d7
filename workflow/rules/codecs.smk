# Codecs: a rate-distortion curve is one archive with a self-contained stream and its cost for each
# rate.
rule encode:
    input:
        unpack(lambda w: coding.cloud(w.dataset, w.cloud)),
        made_by=made_by("coded/{dataset}/{cloud}/{codec}", lambda w: coding.encode(*curve_of(w))),
    output:
        f"{RESULTS}/coded/{{dataset}}/{{cloud}}/{{codec}}.zip",
    log:
        f"{RESULTS}/logs/coded/{{dataset}}/{{cloud}}/{{codec}}.log",
    priority: priority_of
    conda:
        "../../envs/puckbench.yaml"
    threads: coding.cores(CORES)
    resources:
        mem_mb=lambda w, attempt: attempt * coding.memory_mb(w.codec),
        runtime=lambda w, attempt: attempt * coding.minutes(w.codec),
    params:
        record=record_of(lambda w: coding.encode(*curve_of(w))),
        code=code_of(lambda w: coding.encode(*curve_of(w))),
        timed=TIMED,
    shell:
        "{params.timed} python -m puckbench.jobs encode_curve {params.record} cloud={input.cloud:q}"
        " curve={output:q} > {log:q} 2>&1"


# The decoded cloud of one rate.
rule decode:
    input:
        curve=f"{RESULTS}/coded/{{dataset}}/{{cloud}}/{{codec}}.zip",
        made_by=made_by(
            "decoded/{dataset}/{cloud}/{codec}/{rate}",
            lambda w: coding.decode(w.dataset, w.codec, w.rate),
        ),
    output:
        cloud=f"{RESULTS}/decoded/{{dataset}}/{{cloud}}/{{codec}}/{{rate}}.ply",
        about=f"{RESULTS}/decoded/{{dataset}}/{{cloud}}/{{codec}}/{{rate}}.json",
    log:
        f"{RESULTS}/logs/decoded/{{dataset}}/{{cloud}}/{{codec}}/{{rate}}.log",
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=lambda w, attempt: attempt * coding.memory_mb(w.codec),
        runtime=lambda w, attempt: attempt * coding.minutes(w.codec),
    params:
        record=record_of(lambda w: coding.decode(w.dataset, w.codec, w.rate)),
        code=code_of(lambda w: coding.decode(w.dataset, w.codec, w.rate)),
    shell:
        "python -m puckbench.jobs decode {params.record} stream={input.curve:q} cloud={output.cloud:q}"
        " > {log:q} 2>&1"


# The decoded clouds of the rates that the report shows.
rule decode_shown:
    input:
        curve=f"{RESULTS}/coded/{{dataset}}/{{cloud}}/{{codec}}.zip",
        made_by=made_by(
            "decoded/{dataset}/{cloud}/{codec}",
            lambda w: coding.decode_shown(w.dataset, w.cloud, w.codec),
        ),
    output:
        f"{RESULTS}/decoded/{{dataset}}/{{cloud}}/{{codec}}.zip",
    log:
        f"{RESULTS}/logs/decoded/{{dataset}}/{{cloud}}/{{codec}}.log",
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=lambda w, attempt: attempt * coding.memory_mb(w.codec),
        runtime=lambda w, attempt: attempt * coding.minutes(w.codec),
    params:
        record=record_of(lambda w: coding.decode_shown(w.dataset, w.cloud, w.codec)),
        code=code_of(lambda w: coding.decode_shown(w.dataset, w.cloud, w.codec)),
    shell:
        "python -m puckbench.jobs decode_shown {params.record} curve={input.curve:q} clouds={output:q}"
        " > {log:q} 2>&1"
