# The report: one HTML file with figures, tables, an interactive plot and a viewer of clouds.
rule report_page:
    input:
        *outputs.report_contents.files(),
        made_by=made_by("report", lambda w: outputs.report),
    output:
        f"{RESULTS}/report.html",
    log:
        f"{RESULTS}/logs/report.log",
    conda:
        "../../envs/puckbench.yaml"
    threads: 2  # the last job of a run
    resources:
        mem_mb=2000,
        runtime=20,
    params:
        record=record_of(lambda w: outputs.report),
        code=outputs.report.code,
        below=lambda w, input: str(input[0]).removesuffix(outputs.report_contents.files()[0]) or ".",
    shell:
        "python -m puckbench.jobs report {params.record} below={params.below:q} page={output:q} > {log:q} 2>&1"


# Reference results: the run's tables in one file, for comparison with other runs.
if outputs.reference_inputs:

    rule reference:
        input:
            **outputs.reference_inputs,
            made_by=made_by("reference", lambda w: outputs.reference),
        output:
            f"{RESULTS}/reference.parquet",
        params:
            record=record_of(lambda w: outputs.reference),
            code=outputs.reference.code,
            files=lambda w, input: files_of(input, outputs.reference_inputs),
        resources:
            mem_mb=1500,
            runtime=10,
        log:
            f"{RESULTS}/logs/reference.log",
        conda:
            "../../envs/puckbench.yaml"
        shell:
            "python -m puckbench.jobs reference {params.record} {params.files} out={output:q} > {log:q} 2>&1"
