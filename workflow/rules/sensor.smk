# Sensor: the errors of the virtual sensor, and of real ones, on a wall and a floor (chapter 5).
if bench.plan.study is not None:

    rule residuals:
        output:
            f"{RESULTS}/residuals/models/{{model}}.parquet",
        params:
            arguments=lambda wildcards: bench.residual_arguments(wildcards.model),
            # Not the command's module, which imports what captures need as well.
            code=lambda wildcards: bench.model_code("puckbench.thesis.residuals.virtual", wildcards.model),
        resources:
            mem_mb=1500,
            runtime=20,
        log:
            f"{RESULTS}/logs/residuals/models/{{model}}.log",
        conda:
            "../../envs/puckbench.yaml"
        shell:
            "python -m puckbench residuals {output} {params.arguments} > {log} 2>&1"

    rule capture_residuals:
        input:
            lambda wildcards: bench.study.captures[wildcards.capture][0],
        output:
            f"{RESULTS}/residuals/captures/{{capture}}.parquet",
        params:
            options=lambda wildcards: json.dumps(bench.study.captures[wildcards.capture][1]),
            code=code_version("puckbench.cli.residuals"),
        resources:
            mem_mb=2000,
            runtime=20,
        log:
            f"{RESULTS}/logs/residuals/captures/{{capture}}.log",
        conda:
            "../../envs/puckbench.yaml"
        shell:
            "python -m puckbench residuals {output} --capture {input}"
            " --capture-options {params.options:q} > {log} 2>&1"

    rule wall_points:
        output:
            f"{RESULTS}/wall_points/{{model}}.parquet",
        params:
            arguments=lambda wildcards: bench.wall_arguments(wildcards.model),
            code=lambda wildcards: bench.model_code("puckbench.thesis.residuals.wall_points", wildcards.model),
        resources:
            mem_mb=1500,
            runtime=10,
        log:
            f"{RESULTS}/logs/wall_points/{{model}}.log",
        conda:
            "../../envs/puckbench.yaml"
        shell:
            "python -m puckbench wall {output} {params.arguments} > {log} 2>&1"

    rule residuals_table:
        input:
            [file for _, file in bench.residual_files()],
        output:
            f"{RESULTS}/tables/residuals.parquet",
        params:
            names=[name for name, _ in bench.residual_files()],
            kind="residuals",
            code=code_version("puckbench.thesis.residuals.joining", "puckbench.io.tables"),
        resources:
            mem_mb=1500,
            runtime=10,
        log:
            f"{RESULTS}/logs/tables/residuals.log",
        conda:
            "../../envs/puckbench.yaml"
        script:
            "../scripts/joined_table.py"

    rule scans_table:
        input:
            [f"{RESULTS}/wall_points/{model}.parquet" for model in bench.study.models],
        output:
            f"{RESULTS}/tables/scans.parquet",
        params:
            names=list(bench.study.models),
            kind="scans",
            code=code_version("puckbench.thesis.residuals.joining", "puckbench.io.tables"),
        resources:
            mem_mb=1500,
            runtime=10,
        log:
            f"{RESULTS}/logs/tables/scans.log",
        conda:
            "../../envs/puckbench.yaml"
        script:
            "../scripts/joined_table.py"

    # Made when it is asked for: not every set of captures tells all of its parameters.
    rule calibration:
        input:
            bench.capture_files(),
        output:
            f"{RESULTS}/residuals/calibrated.yaml",
        params:
            code=code_version("puckbench.cli.calibrate"),
        resources:
            mem_mb=2000,
            runtime=20,
        log:
            f"{RESULTS}/logs/residuals/calibrated.log",
        conda:
            "../../envs/puckbench.yaml"
        shell:
            "python -m puckbench calibrate {input} {output} > {log} 2>&1"

    rule compared_residuals:
        input:
            bench.capture_files(),
        output:
            f"{RESULTS}/tables/compared_residuals.parquet",
        params:
            code=code_version("puckbench.thesis.residuals.model_comparison", "puckbench.io.tables"),
        resources:
            mem_mb=3000,
            runtime=20,
        log:
            f"{RESULTS}/logs/tables/compared_residuals.log",
        conda:
            "../../envs/puckbench.yaml"
        script:
            "../scripts/compared_residuals.py"


# Each a rule of its own, so that a change of one table's code makes that one.
for table, inputs in bench.study_tables().items():

    rule:
        name:
            table
        input:
            **inputs,
        output:
            csv=report(
                f"{RESULTS}/tables/{table}.csv",
                category=table_entry(table).category,
                labels={"table": table_entry(table).title},
            ),
            parquet=f"{RESULTS}/tables/{table}.parquet",
        params:
            table=table,
            inputs=lambda wildcards, input: json.dumps(dict(input.items())),
            code=bench.table_code(table),
        resources:
            mem_mb=1500,
            runtime=10,
        log:
            f"{RESULTS}/logs/tables/{table}.log",
        conda:
            "../../envs/puckbench.yaml"
        shell:
            "python -m puckbench table {params.table} {output.csv} {output.parquet}"
            " --inputs {params.inputs:q} > {log} 2>&1"


STUDY_TABLES = [
    f"{RESULTS}/tables/{table}.{suffix}"
    for table in bench.study_tables()
    for suffix in ("csv", "parquet")
]