# The report: one HTML file with figures, tables, an interactive plot and clouds to turn.
rule report_page:
    input:
        outputs.report_contents.files(),
    output:
        f"{RESULTS}/report.html",
    log:
        f"{RESULTS}/logs/report.log",
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=2000,
        runtime=20,
    params:
        record=outputs.report.record,
        code=outputs.report.code,
    shell:
        "python -m puckbench.jobs report {params.record:q} page={output:q} > {log:q} 2>&1"
