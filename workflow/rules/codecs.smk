# Codecs: one self-contained stream for each cloud, codec and rate; decoded clouds when asked for.
CELL = "{dataset}/{cloud}/{codec}/{rate}"


# What is made together is followed by one of its files: there are tens of thousands of these jobs,
# and planning pays for each input of each.
rule encode:
    input:
        cloud=f"{RESULTS}/clouds/{{dataset}}/{{cloud}}.ply",
    output:
        stream=f"{RESULTS}/coded/{CELL}.bin",
        about=f"{RESULTS}/coded/{CELL}.bin.json",
    params:
        record=lambda w: coding.encode(w.codec, w.rate).record,
        code=lambda w: coding.encode(w.codec, w.rate).code,
        timed=coding.threads_environment,
    threads: coding.cores(CORES)
    resources:
        mem_mb=lambda w, attempt: attempt * coding.memory_mb(w.codec),
        runtime=30,
    log:
        f"{RESULTS}/logs/coded/{CELL}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "{params.timed} python -m puckbench.jobs encode {params.record:q} cloud={input.cloud:q} stream={output.stream:q}"
        " > {log:q} 2>&1"


rule decode:
    input:
        stream=f"{RESULTS}/coded/{CELL}.bin",
    output:
        cloud=f"{RESULTS}/decoded/{CELL}.ply",
        about=f"{RESULTS}/decoded/{CELL}.json",
    params:
        record=lambda w: coding.decode(w.codec, w.rate).record,
        code=lambda w: coding.decode(w.codec, w.rate).code,
    resources:
        mem_mb=lambda w, attempt: attempt * coding.memory_mb(w.codec),
        runtime=30,
    log:
        f"{RESULTS}/logs/decoded/{CELL}.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench.jobs decode {params.record:q} stream={input.stream:q} cloud={output.cloud:q} > {log:q} 2>&1"
