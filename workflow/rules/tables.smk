# Tables: all results, all clouds, and tables made of these.
rule results_table:
    input:
        rows=lambda w: outputs.gathered[w.table].files(plan.results),
        made_by=made_by("tables/{table}", lambda w: outputs.gathered[w.table].job),
    output:
        csv=report(f"{RESULTS}/tables/{{table}}.csv", category="Tables", labels={"table": "{table}"}),
        parquet=f"{RESULTS}/tables/{{table}}.parquet",
        columns=f"{RESULTS}/tables/columns/{{table}}.csv",
    log:
        f"{RESULTS}/logs/tables/{{table}}.log",
    wildcard_constraints:
        table=one_of(outputs.gathered),
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        record=record_of(lambda w: outputs.gathered[w.table].job),
        job=lambda w: outputs.gathered[w.table].job.name,
        code=code_of(lambda w: outputs.gathered[w.table].job),
        results=lambda w, input: outputs.gathered[w.table].folder(input.rows, plan.results),
    shell:
        "python -m puckbench.jobs {params.job} {params.record} results={params.results:q} csv={output.csv:q}"
        " parquet={output.parquet:q} columns={output.columns:q} > {log:q} 2>&1"


rule table:
    input:
        unpack(lambda w: outputs.tables[w.table]),
        made_by=made_by("tables/{table}", lambda w: outputs.table(w.table)),
    output:
        csv=report(
            f"{RESULTS}/tables/{{table}}.csv",
            category=lambda w: table_entry(w.table).category,
            labels={"table": "{table}"},
        ),
        parquet=f"{RESULTS}/tables/{{table}}.parquet",
        tex=f"{RESULTS}/tables/{{table}}.tex",
        columns=f"{RESULTS}/tables/columns/{{table}}.csv",
    log:
        f"{RESULTS}/logs/tables/{{table}}.log",
    wildcard_constraints:
        table=one_of(outputs.tables),
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        record=record_of(lambda w: outputs.table(w.table)),
        code=code_of(lambda w: outputs.table(w.table)),
        tables=lambda w, input: files_of(input, outputs.tables[w.table]),
    shell:
        "python -m puckbench.jobs table {params.record} {params.tables} out={output.csv:q} {output.parquet:q}"
        " {output.tex:q} columns={output.columns:q} > {log:q} 2>&1"


STUDY_TABLES = [
    f"{RESULTS}/tables/{table}.{suffix}"
    for table in outputs.study_tables
    for suffix in ("csv", "parquet")
]
TABLES = [
    f"{RESULTS}/tables/{table}.{suffix}"
    for table in (*outputs.gathered, *outputs.tables)
    for suffix in ("csv", "parquet")
]
