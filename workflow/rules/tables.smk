# Tables: all results in one tidy table, what the clouds are, and medians per rate.
rule metrics_table:
    input:
        [f"{RESULTS}/metrics/{'/'.join(cell)}.json" for cell in bench.plan.cells],
    output:
        csv=report(f"{RESULTS}/tables/metrics.csv", category="Tables"),
        parquet=f"{RESULTS}/tables/metrics.parquet",
        summary=report(f"{RESULTS}/tables/summary.csv", category="Tables"),
    params:
        code=code_version("puckbench.jobs.result_tables", "puckbench.io.tables"),
    resources:
        mem_mb=1000,
        runtime=10,
    log:
        f"{RESULTS}/logs/tables/metrics.log",
    conda:
        "../../envs/puckbench.yaml"
    script:
        "../scripts/metrics_table.py"


rule clouds_table:
    input:
        [f"{RESULTS}/clouds/{dataset}/{cloud}.json" for dataset, cloud in bench.plan.clouds],
    output:
        csv=report(f"{RESULTS}/tables/clouds.csv", category="Tables"),
        parquet=f"{RESULTS}/tables/clouds.parquet",
    params:
        datasets=[dataset for dataset, _ in bench.plan.clouds],
        code=code_version("puckbench.jobs.result_tables", "puckbench.io.tables"),
    resources:
        mem_mb=500,
        runtime=10,
    log:
        f"{RESULTS}/logs/tables/clouds.log",
    conda:
        "../../envs/puckbench.yaml"
    script:
        "../scripts/clouds_table.py"


# Where a scan's true surface is known, and where a codec's primitives have labels to be held against.
for kind, files in bench.row_tables().items():

    rule:
        name:
            f"{kind}_table"
        input:
            files,
        output:
            csv=report(f"{RESULTS}/tables/{kind}.csv", category="Tables"),
            parquet=f"{RESULTS}/tables/{kind}.parquet",
        params:
            kind=kind,
            code=code_version("puckbench.jobs.result_tables", "puckbench.io.tables"),
        resources:
            mem_mb=500,
            runtime=10,
        log:
            f"{RESULTS}/logs/tables/{kind}.log",
        conda:
            "../../envs/puckbench.yaml"
        script:
            "../scripts/rows_table.py"


# Each a rule of its own, as the tables of the sensor study.
for table, inputs in bench.result_tables().items():

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
            options=bench.table_options(table),
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
            " --inputs {params.inputs:q} --options {params.options:q} > {log} 2>&1"


TABLES = list(STUDY_TABLES)
if bench.plan.datasets:
    TABLES += [*rules.metrics_table.output, *rules.clouds_table.output]
TABLES += [
    f"{RESULTS}/tables/{table}.{suffix}"
    for table in [*bench.row_tables(), *bench.result_tables()]
    for suffix in ("csv", "parquet")
]
