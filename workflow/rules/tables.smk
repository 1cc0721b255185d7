# Tables: all results in one tidy table, what the clouds are, and what is made of these.
for table, joined in outputs.joined_tables().items():

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
            mem_mb=1000,
            runtime=10,
        params:
            job=joined.job.name,
            record=joined.job.record,
            code=joined.job.code,
        script:
            "../scripts/job.py"


# Each a rule of its own, so that a change of one table's code makes that one.
for table, inputs in outputs.tables.items():

    rule:
        name:
            table
        input:
            **inputs,
        output:
            csv=report(f"{RESULTS}/tables/{table}.csv", category=outputs.table_category(table)),
            parquet=f"{RESULTS}/tables/{table}.parquet",
        log:
            f"{RESULTS}/logs/tables/{table}.log",
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=1500,
            runtime=10,
        params:
            record=outputs.table(table).record,
            code=outputs.table(table).code,
        shell:
            "python -m puckbench.jobs table {params.record:q} out={output.csv:q} {output.parquet:q} > {log:q} 2>&1"


STUDY_TABLES = [
    f"{RESULTS}/tables/{table}.{suffix}"
    for table in outputs.study_tables
    for suffix in ("csv", "parquet")
]
TABLES = [file for joined in outputs.joined_tables().values() for file in joined.outputs.values()]
TABLES += [
    f"{RESULTS}/tables/{table}.{suffix}"
    for table in outputs.tables
    for suffix in ("csv", "parquet")
]
