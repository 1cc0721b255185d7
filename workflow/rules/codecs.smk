# Codecs: a rate-distortion curve is one archive with a self-contained stream and its cost for each
# rate.
encode = rules_of("encode", "coded/{dataset}/{cloud}/{codec}")


rule encode:
    input:
        unpack(encode.inputs),
    output:
        f"{RESULTS}/coded/{{dataset}}/{{cloud}}/{{codec}}.zip",
    log:
        encode.log,
    priority: priority_of
    conda:
        "../../envs/puckbench.yaml"
    threads: flow.costs.cores(CORES)
    resources:
        mem_mb=encode.memory_mb,
        runtime=encode.minutes,
    params:
        settings=encode.settings,
        key=encode.key,
        timed=TIMED,
    shell:
        "{params.timed} python -m puckbench.steps encode {params.settings} cloud={input.cloud:q}"
        " curve={output:q} --key={params.key} > {log:q} 2>&1"


# The decoded cloud of one rate.
decode = rules_of("decode", "decoded/{dataset}/{cloud}/{codec}/{rate}")


rule decode:
    input:
        unpack(decode.inputs),
    output:
        cloud=f"{RESULTS}/decoded/{{dataset}}/{{cloud}}/{{codec}}/{{rate}}.ply",
        about=f"{RESULTS}/decoded/{{dataset}}/{{cloud}}/{{codec}}/{{rate}}.json",
    log:
        decode.log,
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=decode.memory_mb,
        runtime=decode.minutes,
    params:
        settings=decode.settings,
        key=decode.key,
    shell:
        "python -m puckbench.steps decode {params.settings} curve={input.curve:q}"
        " cloud={output.cloud:q} --key={params.key} > {log:q} 2>&1"


# The decoded clouds of the rates that the report shows.
decode_shown = rules_of("decode_shown", "decoded/{dataset}/{cloud}/{codec}")


rule decode_shown:
    input:
        unpack(decode_shown.inputs),
    output:
        f"{RESULTS}/decoded/{{dataset}}/{{cloud}}/{{codec}}.zip",
    log:
        decode_shown.log,
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=decode_shown.memory_mb,
        runtime=decode_shown.minutes,
    params:
        settings=decode_shown.settings,
        key=decode_shown.key,
    shell:
        "python -m puckbench.steps decode_shown {params.settings} curve={input.curve:q}"
        " clouds={output:q} --key={params.key} > {log:q} 2>&1"
