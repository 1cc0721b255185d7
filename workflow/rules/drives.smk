# Drives of a moving sensor with their poses, coded turn by turn, and tasks on the decoded turns.
rule drive:
    input:
        unpack(planned(lambda w: drives.source(w.drives, w.drive))),
        made_by=made_by("drives/{drives}/{drive}", lambda w: drives.drive(w.drives, w.drive)),
    output:
        f"{RESULTS}/drives/{{drives}}/{{drive}}.zip",
    log:
        f"{RESULTS}/logs/drives/{{drives}}/{{drive}}.log",
    wildcard_constraints:
        drives=one_of(drives.virtual),
    priority: 1
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        record=record_of(lambda w: drives.drive(w.drives, w.drive)),
        code=code_of(lambda w: drives.drive(w.drives, w.drive)),
    shell:
        "python -m puckbench.jobs drive {params.record} mesh={input.scene:q} drive={output:q} > {log:q} 2>&1"


# Consecutive clouds of a data set.
rule drive_of_clouds:
    input:
        unpack(planned(lambda w: by_content(drives.files(w.drives, w.drive)))),
        made_by=made_by("drives/{drives}/{drive}", lambda w: drives.drive(w.drives, w.drive)),
    output:
        f"{RESULTS}/drives/{{drives}}/{{drive}}.zip",
    log:
        f"{RESULTS}/logs/drives/{{drives}}/{{drive}}.log",
    wildcard_constraints:
        drives=one_of(drives.real),
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        record=record_of(lambda w: drives.drive(w.drives, w.drive)),
        code=code_of(lambda w: drives.drive(w.drives, w.drive)),
    shell:
        "python -m puckbench.jobs drive_of_clouds {params.record} drive={output:q} > {log:q} 2>&1"


rule encode_drive:
    input:
        drive=f"{RESULTS}/drives/{{drives}}/{{drive}}.zip",
        made_by=made_by(
            "coded_drives/{drives}/{drive}/{codec}", lambda w: drives.encode(w.drives, w.codec)
        ),
    output:
        f"{RESULTS}/coded_drives/{{drives}}/{{drive}}/{{codec}}.zip",
    log:
        f"{RESULTS}/logs/coded_drives/{{drives}}/{{drive}}/{{codec}}.log",
    conda:
        "../../envs/puckbench.yaml"
    threads: coding.cores(CORES)
    resources:
        mem_mb=lambda w, attempt: attempt * 2 * coding.memory_mb(w.codec),
        runtime=lambda w, attempt: attempt * drives.minutes(w.drives),
    params:
        record=record_of(lambda w: drives.encode(w.drives, w.codec)),
        code=code_of(lambda w: drives.encode(w.drives, w.codec)),
        timed=TIMED,
    shell:
        "{params.timed} python -m puckbench.jobs encode_drive {params.record} drive={input.drive:q} curve={output:q}"
        " > {log:q} 2>&1"


rule measure_drive:
    input:
        drive=f"{RESULTS}/drives/{{drives}}/{{drive}}.zip",
        curve=f"{RESULTS}/coded_drives/{{drives}}/{{drive}}/{{codec}}.zip",
        made_by=made_by(
            "drive_tasks/{drives}/{drive}/{codec}", lambda w: drives.measure(w.drives, w.codec)
        ),
    output:
        f"{RESULTS}/drive_tasks/{{drives}}/{{drive}}/{{codec}}.parquet",
    log:
        f"{RESULTS}/logs/drive_tasks/{{drives}}/{{drive}}/{{codec}}.log",
    conda:
        "../../envs/puckbench.yaml"
    threads: coding.cores(CORES)
    resources:
        mem_mb=lambda w, attempt: attempt * 2 * coding.memory_mb(w.codec),
        runtime=lambda w, attempt: attempt * drives.minutes(w.drives),
    params:
        record=record_of(lambda w: drives.measure(w.drives, w.codec)),
        code=code_of(lambda w: drives.measure(w.drives, w.codec)),
        timed=TIMED,
    shell:
        "{params.timed} python -m puckbench.jobs measure_drive {params.record} drive={input.drive:q}"
        " curve={input.curve:q} rows={output:q} > {log:q} 2>&1"


rule measure_undecoded:
    input:
        drive=f"{RESULTS}/drives/{{drives}}/{{drive}}.zip",
        made_by=made_by(
            "drive_tasks/{drives}/{drive}/undecoded",
            lambda w: drives.measure(w.drives, "undecoded"),
        ),
    output:
        f"{RESULTS}/drive_tasks/{{drives}}/{{drive}}/undecoded.parquet",
    log:
        f"{RESULTS}/logs/drive_tasks/{{drives}}/{{drive}}/undecoded.log",
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        record=record_of(lambda w: drives.measure(w.drives, "undecoded")),
        code=code_of(lambda w: drives.measure(w.drives, "undecoded")),
    shell:
        "python -m puckbench.jobs measure_drive {params.record} drive={input.drive:q} rows={output:q} > {log:q} 2>&1"
