# The report: one HTML file with figures, tables, an interactive plot and a viewer of clouds.
report_page = rules_of("report_page", "report")


CONTENTS = flow.outputs.report_contents.files()


rule report_page:
    input:
        unpack(report_page.inputs),
    output:
        f"{RESULTS}/report.html",
    log:
        report_page.log,
    conda:
        "../../envs/puckbench.yaml"
    threads: 2  # the last job of a run
    resources:
        mem_mb=report_page.memory_mb,
        runtime=report_page.minutes,
    params:
        settings=report_page.settings,
        key=report_page.key,
        below=lambda w, input: str(input.files[0]).removesuffix(CONTENTS[0]) or ".",
    shell:
        "python -m puckbench.steps report_page {params.settings} below={params.below:q}"
        " page={output:q} --key={params.key} > {log:q} 2>&1"


# Reference results: the run's tables in one file, for comparison with other runs.
if flow.outputs.reference_inputs:

    reference = rules_of("reference", "reference")

    rule reference:
        input:
            unpack(reference.inputs),
        output:
            f"{RESULTS}/reference.parquet",
        log:
            reference.log,
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=reference.memory_mb,
            runtime=reference.minutes,
        params:
            settings=reference.settings,
            key=reference.key,
            files=lambda w, input: words_of(input, flow.outputs.reference_inputs),
        shell:
            "python -m puckbench.steps reference {params.settings} {params.files} out={output:q}"
            " --key={params.key} > {log:q} 2>&1"
