# The report: one HTML file with figures, tables, an interactive plot and clouds to turn.
PAGE = bench.report()


rule report_page:
    input:
        PAGE.files(),
    output:
        f"{RESULTS}/report.html",
    params:
        contents=json.dumps(PAGE.as_json(), sort_keys=True),
        code=bench.report_code(),
    resources:
        mem_mb=2000,
        runtime=20,
    log:
        f"{RESULTS}/logs/report.log",
    conda:
        "../../envs/puckbench.yaml"
    shell:
        "python -m puckbench report {output} --contents {params.contents:q} > {log} 2>&1"
