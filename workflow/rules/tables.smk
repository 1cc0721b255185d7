# Tables: all results, all clouds, and tables made of these.
results_table = rules_of("results_table", "tables/{table}")


rule results_table:
    input:
        unpack(results_table.inputs),
    output:
        csv=report(f"{RESULTS}/tables/{{table}}.csv", category="Tables", labels={"table": "{table}"}),
        parquet=f"{RESULTS}/tables/{{table}}.parquet",
        columns=f"{RESULTS}/tables/columns/{{table}}.csv",
    log:
        results_table.log,
    wildcard_constraints:
        table=one_of(flow.outputs.gathered),
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=results_table.memory_mb,
        runtime=results_table.minutes,
    params:
        settings=results_table.settings,
        key=results_table.key,
        results=results_table.folder,
    shell:
        "python -m puckbench.steps results_table {params.settings} results={params.results}"
        " csv={output.csv:q} parquet={output.parquet:q} columns={output.columns:q}"
        " --key={params.key} > {log:q} 2>&1"


table = rules_of("table", "tables/{table}")


rule table:
    input:
        unpack(table.inputs),
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
        table.log,
    wildcard_constraints:
        table=one_of(flow.outputs.tables),
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=table.memory_mb,
        runtime=table.minutes,
    params:
        settings=table.settings,
        key=table.key,
        tables=lambda w, input: words_of(input, flow.outputs.tables[w.table]),
    shell:
        "python -m puckbench.steps table {params.settings} {params.tables}"
        " out={output.csv:q} {output.parquet:q} {output.tex:q} columns={output.columns:q}"
        " --key={params.key} > {log:q} 2>&1"


STUDY_TABLES = [
    f"{RESULTS}/tables/{table}.{suffix}"
    for table in flow.outputs.study_tables
    for suffix in ("csv", "parquet")
]
TABLES = [
    f"{RESULTS}/tables/{table}.{suffix}"
    for table in (*flow.outputs.gathered, *flow.outputs.tables)
    for suffix in ("csv", "parquet")
]
