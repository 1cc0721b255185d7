# Sensor study: errors of the virtual sensor and of real ones on a wall and a floor (chapter 5).
if plan.study is not None:

    rule residuals:
        input:
            files=lambda w: ancient(study.model_files(w.model)),
            made_by=made_by("residuals/models/{model}", lambda w: study.residuals(w.model)),
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
            record=record_of(lambda w: study.residuals(w.model)),
            code=code_of(lambda w: study.residuals(w.model)),
        shell:
            "python -m puckbench.jobs residuals {params.record} table={output:q} > {log:q} 2>&1"

    rule capture_residuals:
        input:
            unpack(lambda w: by_content(study.recording(w.capture))),
            made_by=made_by(
                "residuals/captures/{capture}", lambda w: study.capture_residuals(w.capture)
            ),
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
            record=record_of(lambda w: study.capture_residuals(w.capture)),
            code=code_of(lambda w: study.capture_residuals(w.capture)),
        shell:
            "python -m puckbench.jobs capture_residuals {params.record} capture={input.capture:q} table={output:q}"
            " > {log:q} 2>&1"

    rule wall_points:
        input:
            files=lambda w: ancient(study.model_files(w.model)),
            made_by=made_by("wall_points/{model}", lambda w: study.wall_points(w.model)),
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
            record=record_of(lambda w: study.wall_points(w.model)),
            code=code_of(lambda w: study.wall_points(w.model)),
        shell:
            "python -m puckbench.jobs wall_points {params.record} table={output:q} > {log:q} 2>&1"

    # Not part of `all`, since not all captures allow an estimate of all parameters.
    rule calibration:
        input:
            residuals=[f"{RESULTS}/{file}" for file in study.capture_files()],
            made_by=made_by("residuals/calibrated", lambda w: study.calibrate()),
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
            record=record_of(lambda w: study.calibrate()),
            code=study.calibrate().code,
        shell:
            "python -m puckbench.jobs calibrate {params.record} residuals={input.residuals:q} model={output:q} > {log:q} 2>&1"

    # Joined tables of several models or recordings.
    rule study_table:
        input:
            rows=lambda w: study.gathered[w.table].files(plan.results),
            made_by=made_by("tables/{table}", lambda w: study.gathered[w.table].job),
        output:
            f"{RESULTS}/tables/{{table}}.parquet",
        log:
            f"{RESULTS}/logs/tables/{{table}}.log",
        wildcard_constraints:
            table=one_of(study.gathered),
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=3000,
            runtime=20,
        params:
            record=record_of(lambda w: study.gathered[w.table].job),
            job=lambda w: study.gathered[w.table].job.name,
            code=code_of(lambda w: study.gathered[w.table].job),
            results=lambda w, input: study.gathered[w.table].folder(input.rows, plan.results),
        shell:
            "python -m puckbench.jobs {params.job} {params.record} results={params.results:q} parquet={output:q}"
            " > {log:q} 2>&1"
