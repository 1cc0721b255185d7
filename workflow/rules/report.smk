# The report: one HTML file with figures, tables, an interactive plot and clouds to turn.
rule report_page:
    input:
        outputs.report_contents.files(),
    output:
        f"{RESULTS}/report.html",
    params:
        record=outputs.report.record,
        code=outputs.report.code,
    resources:
        mem_mb=2000,
        runtime=20,
    log:
        f"{RESULTS}/logs/report.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench.jobs report {params.record:q} page={output:q} > {log:q} 2>&1"
