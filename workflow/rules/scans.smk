# Scans: tables of all returns of the virtual sensor, clean and noisy.
rule scan:
    input:
        scene=lambda w: clouds.scene_file(w.dataset, w.cloud),
        about=lambda w: clouds.scene_file(w.dataset, w.cloud, "json"),
        files=lambda w: ancient(clouds.sensing_files(w.dataset)),
        made_by=made_by("scans/{dataset}/{cloud}", lambda w: clouds.scan(w.dataset, w.cloud)),
    output:
        f"{RESULTS}/scans/{{dataset}}/{{cloud}}.parquet",
    log:
        f"{RESULTS}/logs/scans/{{dataset}}/{{cloud}}.log",
    priority: 1
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=lambda w, attempt: attempt * clouds.memory_mb(w.dataset),
        runtime=10,
    params:
        record=record_of(lambda w: clouds.scan(w.dataset, w.cloud)),
        code=code_of(lambda w: clouds.scan(w.dataset, w.cloud)),
    shell:
        "python -m puckbench.jobs scan {params.record} mesh={input.scene:q} table={output:q} > {log:q} 2>&1"
