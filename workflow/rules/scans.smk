# Scans: tables of all returns of the virtual sensor, clean and noisy.
scan = rules_of("scan", "scans/{dataset}/{cloud}")


rule scan:
    input:
        unpack(scan.inputs),
    output:
        f"{RESULTS}/scans/{{dataset}}/{{cloud}}.parquet",
    log:
        scan.log,
    priority: priority_of
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=scan.memory_mb,
        runtime=scan.minutes,
    params:
        settings=scan.settings,
        key=scan.key,
    shell:
        "python -m puckbench.steps scan {params.settings} mesh={input.scene:q} table={output:q}"
        " --key={params.key} > {log:q} 2>&1"
