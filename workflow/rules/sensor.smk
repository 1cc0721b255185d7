# Sensor: the errors of the virtual sensor, and of real ones, on a wall and a floor (chapter 5).
if plan.study is not None:

    rule residuals:
        output:
            f"{RESULTS}/residuals/models/{{model}}.parquet",
        log:
            f"{RESULTS}/logs/residuals/models/{{model}}.log",
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=1500,
            runtime=20,
        params:
            record=lambda w: study.residuals(w.model).record,
            code=lambda w: study.residuals(w.model).code,
        shell:
            "python -m puckbench.jobs residuals {params.record:q} table={output:q} > {log:q} 2>&1"

    rule capture_residuals:
        input:
            lambda w: plan.study.captures[w.capture][0],
        output:
            f"{RESULTS}/residuals/captures/{{capture}}.parquet",
        log:
            f"{RESULTS}/logs/residuals/captures/{{capture}}.log",
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=2000,
            runtime=20,
        params:
            record=lambda w: study.capture_residuals(w.capture).record,
            code=lambda w: study.capture_residuals(w.capture).code,
        shell:
            "python -m puckbench.jobs capture_residuals {params.record:q} capture={input:q} table={output:q} > {log:q} 2>&1"

    rule wall_points:
        output:
            f"{RESULTS}/wall_points/{{model}}.parquet",
        log:
            f"{RESULTS}/logs/wall_points/{{model}}.log",
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=1500,
            runtime=10,
        params:
            record=lambda w: study.wall_points(w.model).record,
            code=lambda w: study.wall_points(w.model).code,
        shell:
            "python -m puckbench.jobs wall_points {params.record:q} table={output:q} > {log:q} 2>&1"

    # Made when it is asked for: not every set of captures tells all of its parameters.
    rule calibration:
        input:
            study.capture_files(),
        output:
            f"{RESULTS}/residuals/calibrated.yaml",
        log:
            f"{RESULTS}/logs/residuals/calibrated.log",
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=2000,
            runtime=20,
        params:
            code=study.calibrate().code,
        shell:
            "python -m puckbench.jobs calibrate {{}} residuals={input:q} model={output:q} > {log:q} 2>&1"

    # Tables of several models or recordings as one.
    for table, joined in study.joined_tables().items():

        rule:
            name:
                f"{table}_table"
            input:
                rows=joined.files,
            output:
                **joined.outputs,
            log:
                f"{RESULTS}/logs/tables/{table}.log",
            conda:
                "../../envs/puckbench.yaml"
            resources:
                mem_mb=3000,
                runtime=20,
            params:
                job=joined.job.name,
                record=joined.job.record,
                code=joined.job.code,
            script:
                "../scripts/job.py"
