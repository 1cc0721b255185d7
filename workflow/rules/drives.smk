# Drives of a moving sensor with their poses, coded turn by turn, and tasks on the decoded turns.
drive = rules_of("drive", "drives/{drives}/{drive}")


rule drive:
    input:
        unpack(drive.inputs),
    output:
        f"{RESULTS}/drives/{{drives}}/{{drive}}.zip",
    log:
        drive.log,
    wildcard_constraints:
        drives=one_of(flow.drives.virtual),
    priority: 1
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=drive.memory_mb,
        runtime=drive.minutes,
    params:
        settings=drive.settings,
        key=drive.key,
    shell:
        "python -m puckbench.steps drive {params.settings} mesh={input.scene:q} drive={output:q}"
        " --key={params.key} > {log:q} 2>&1"


# Consecutive clouds of a scene set.
drive_of_clouds = rules_of("drive_of_clouds", "drives/{drives}/{drive}")


rule drive_of_clouds:
    input:
        unpack(drive_of_clouds.inputs),
    output:
        f"{RESULTS}/drives/{{drives}}/{{drive}}.zip",
    log:
        drive_of_clouds.log,
    wildcard_constraints:
        drives=one_of(flow.drives.real),
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=drive_of_clouds.memory_mb,
        runtime=drive_of_clouds.minutes,
    params:
        settings=drive_of_clouds.settings,
        key=drive_of_clouds.key,
    shell:
        "python -m puckbench.steps drive_of_clouds {params.settings} drive={output:q}"
        " --key={params.key} > {log:q} 2>&1"


encode_drive = rules_of("encode_drive", "coded_drives/{drives}/{drive}/{codec}")


rule encode_drive:
    input:
        unpack(encode_drive.inputs),
    output:
        f"{RESULTS}/coded_drives/{{drives}}/{{drive}}/{{codec}}.zip",
    log:
        encode_drive.log,
    conda:
        "../../envs/puckbench.yaml"
    threads: flow.costs.cores(CORES)
    resources:
        mem_mb=encode_drive.memory_mb,
        runtime=encode_drive.minutes,
    params:
        settings=encode_drive.settings,
        key=encode_drive.key,
        timed=TIMED,
    shell:
        "{params.timed} python -m puckbench.steps encode_drive {params.settings}"
        " drive={input.drive:q} curve={output:q} --key={params.key} > {log:q} 2>&1"


measure_drive = rules_of("measure_drive", "drive_tasks/{drives}/{drive}/{codec}")


rule measure_drive:
    input:
        unpack(measure_drive.inputs),
    output:
        rows=f"{RESULTS}/drive_tasks/{{drives}}/{{drive}}/{{codec}}.parquet",
        trajectories=directory(f"{RESULTS}/trajectories/{{drives}}/{{drive}}/{{codec}}"),
    log:
        measure_drive.log,
    conda:
        "../../envs/puckbench.yaml"
    threads: flow.costs.cores(CORES)
    resources:
        mem_mb=measure_drive.memory_mb,
        runtime=measure_drive.minutes,
    params:
        settings=measure_drive.settings,
        key=measure_drive.key,
        timed=TIMED,
    shell:
        "{params.timed} python -m puckbench.steps measure_drive {params.settings}"
        " drive={input.drive:q} curve={input.curve:q} rows={output.rows:q}"
        " trajectories={output.trajectories:q} --key={params.key} > {log:q} 2>&1"


measure_undecoded = rules_of("measure_undecoded", "drive_tasks/{drives}/{drive}/undecoded")


rule measure_undecoded:
    input:
        unpack(measure_undecoded.inputs),
    output:
        rows=f"{RESULTS}/drive_tasks/{{drives}}/{{drive}}/undecoded.parquet",
        trajectories=directory(f"{RESULTS}/trajectories/{{drives}}/{{drive}}/undecoded"),
    log:
        measure_undecoded.log,
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=measure_undecoded.memory_mb,
        runtime=measure_undecoded.minutes,
    params:
        settings=measure_undecoded.settings,
        key=measure_undecoded.key,
    shell:
        "python -m puckbench.steps measure_undecoded {params.settings} drive={input.drive:q}"
        " rows={output.rows:q} trajectories={output.trajectories:q} --key={params.key} > {log:q} 2>&1"
