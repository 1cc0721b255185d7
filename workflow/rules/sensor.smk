# Sensor study: errors of the virtual sensor and of real ones on a wall and a floor (chapter 5).
if flow.study is not None:

    residuals = rules_of("residuals", "residuals/models/{model}")

    rule residuals:
        input:
            unpack(residuals.inputs),
        output:
            f"{RESULTS}/residuals/models/{{model}}.parquet",
        log:
            residuals.log,
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=residuals.memory_mb,
            runtime=residuals.minutes,
        params:
            settings=residuals.settings,
            key=residuals.key,
        shell:
            "python -m puckbench.steps residuals {params.settings} table={output:q}"
            " --key={params.key} > {log:q} 2>&1"

    capture_residuals = rules_of("capture_residuals", "residuals/captures/{capture}")

    rule capture_residuals:
        input:
            unpack(capture_residuals.inputs),
        output:
            f"{RESULTS}/residuals/captures/{{capture}}.parquet",
        log:
            capture_residuals.log,
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=capture_residuals.memory_mb,
            runtime=capture_residuals.minutes,
        params:
            settings=capture_residuals.settings,
            key=capture_residuals.key,
        shell:
            "python -m puckbench.steps capture_residuals {params.settings} capture={input.capture:q}"
            " table={output:q} --key={params.key} > {log:q} 2>&1"

    wall_points = rules_of("wall_points", "wall_points/{model}")

    rule wall_points:
        input:
            unpack(wall_points.inputs),
        output:
            f"{RESULTS}/wall_points/{{model}}.parquet",
        log:
            wall_points.log,
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=wall_points.memory_mb,
            runtime=wall_points.minutes,
        params:
            settings=wall_points.settings,
            key=wall_points.key,
        shell:
            "python -m puckbench.steps wall_points {params.settings} table={output:q}"
            " --key={params.key} > {log:q} 2>&1"

    # Not part of `all`, since not all captures allow an estimate of all parameters.
    calibration = rules_of("calibration", "residuals/calibrated")

    rule calibration:
        input:
            unpack(calibration.inputs),
        output:
            f"{RESULTS}/residuals/calibrated.yaml",
        log:
            calibration.log,
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=calibration.memory_mb,
            runtime=calibration.minutes,
        params:
            settings=calibration.settings,
            key=calibration.key,
        shell:
            "python -m puckbench.steps calibration {params.settings} residuals={input.residuals:q}"
            " model={output:q} --key={params.key} > {log:q} 2>&1"

    # Joined tables of several models or recordings.
    study_table = rules_of("study_table", "tables/{table}")

    rule study_table:
        input:
            unpack(study_table.inputs),
        output:
            parquet=f"{RESULTS}/tables/{{table}}.parquet",
        log:
            study_table.log,
        wildcard_constraints:
            table=one_of(flow.study.gathered),
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=study_table.memory_mb,
            runtime=study_table.minutes,
        params:
            settings=study_table.settings,
            key=study_table.key,
            results=study_table.folder,
        shell:
            "python -m puckbench.steps study_table {params.settings} results={params.results}"
            " parquet={output:q} --key={params.key} > {log:q} 2>&1"
