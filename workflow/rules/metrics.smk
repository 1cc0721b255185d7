# Metrics: a result row for each cloud, codec and rate, from the stream's bytes alone.
rule evaluate:
    input:
        unpack(lambda w: coding.truth(w.dataset, w.cloud)),
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        stream=f"{RESULTS}/coded/{CELL}.bin",
    output:
        f"{RESULTS}/metrics/{CELL}.json",
    params:
        record=lambda w: coding.evaluate(w.dataset, w.codec, w.rate).record,
        code=lambda w: coding.evaluate(w.dataset, w.codec, w.rate).code,
        truth=lambda w: files_of(coding.truth(w.dataset, w.cloud)),
        timed=coding.threads_environment,
    threads: coding.cores(CORES)
    resources:
        mem_mb=lambda w, attempt: attempt * coding.memory_mb(w.codec),
        runtime=30,
    log:
        f"{RESULTS}/logs/metrics/{CELL}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "{params.timed} python -m puckbench.jobs evaluate {params.record:q} cloud={input.cloud:q}"
        " decoded={input.stream:q} row={output:q} {params.truth} > {log:q} 2>&1"


# A scan measured as if it had been decoded: what of the truth it lacks before any codec.
rule scan_error:
    input:
        unpack(lambda w: coding.truth(w.dataset, w.cloud)),
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
        about=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.json",
    output:
        f"{RESULTS}/scan_errors/{{dataset}}/{{cloud}}.json",
    params:
        record=lambda w: coding.scan_error(w.dataset).record,
        code=lambda w: coding.scan_error(w.dataset).code,
        truth=lambda w: files_of(coding.truth(w.dataset, w.cloud)),
    resources:
        mem_mb=lambda w, attempt: attempt * clouds.memory_mb(w.dataset),
        runtime=30,
    log:
        f"{RESULTS}/logs/scan_errors/{{dataset}}/{{cloud}}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench.jobs evaluate {params.record:q} cloud={input.cloud:q} decoded={input.cloud:q}"
        " row={output:q} {params.truth} > {log:q} 2>&1"


# Geometric primitives of a stream's surface against those that the scene is made of.
rule recovery:
    input:
        stream=f"{RESULTS}/coded/{CELL}.bin",
        coded=f"{RESULTS}/coded/{CELL}.bin.json",
        points=lambda w: clouds.true_points(w.dataset, w.cloud),
        scene=lambda w: clouds.scene_file(w.dataset, w.cloud),
        about=lambda w: clouds.scene_file(w.dataset, w.cloud, "json"),
    output:
        f"{RESULTS}/recovery/{CELL}.json",
    params:
        record=lambda w: coding.recovery(w.dataset, w.codec, w.rate).record,
        code=lambda w: coding.recovery(w.dataset, w.codec, w.rate).code,
    resources:
        mem_mb=lambda w, attempt: attempt * clouds.memory_mb(w.dataset),
        runtime=30,
    log:
        f"{RESULTS}/logs/recovery/{CELL}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench.jobs recovery {params.record:q} stream={input.stream:q} points={input.points:q}"
        " scene={input.scene:q} row={output:q} > {log:q} 2>&1"
