# Figures.
rule figure:
    input:
        unpack(lambda w: coding.described(outputs.drawable[w.figure])),
        made_by=made_by("figures/{figure}", lambda w: outputs.figure(w.figure)),
    output:
        pdf=f"{RESULTS}/figures/{{figure}}.pdf",
        svg=f"{RESULTS}/figures/{{figure}}.svg",
        png=report(
            f"{RESULTS}/figures/{{figure}}.png",
            category=lambda w: figure_entry(w.figure).category,
            labels=lambda w: {"figure": figure_entry(w.figure).title},
        ),
    log:
        f"{RESULTS}/logs/figures/{{figure}}.log",
    wildcard_constraints:
        figure=one_of(outputs.drawable),
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        record=record_of(lambda w: outputs.figure(w.figure)),
        code=code_of(lambda w: outputs.figure(w.figure)),
        inputs=lambda w, input: files_of(input, outputs.drawable[w.figure]),
    shell:
        "python -m puckbench.jobs figure {params.record} {params.inputs} out={output.pdf:q} {output.svg:q}"
        " {output.png:q}"
        " > {log:q} 2>&1"


# Figures of the first codec's results, drawn early: the jobs that they need have a high priority.
FIRST_FIGURES = [f"{RESULTS}/first_look/{name}.png" for name in outputs.first_figures]
if FIRST_FIGURES:

    rule first_look:
        input:
            rows=outputs.first_look.files(plan.results),
            made_by=made_by("first_look", lambda w: outputs.first_look.job),
        output:
            parquet=f"{RESULTS}/first_look/metrics.parquet",
            images=FIRST_FIGURES,
        log:
            f"{RESULTS}/logs/first_look.log",
        priority: 2
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=1500,
            runtime=10,
        params:
            record=record_of(lambda w: outputs.first_look.job),
            code=outputs.first_look.job.code,
            results=lambda w, input: outputs.first_look.folder(input.rows, plan.results),
        shell:
            "python -m puckbench.jobs first_look {params.record} results={params.results:q}"
            " parquet={output.parquet:q} out={output.images:q} > {log:q} 2>&1"


FIGURES = [
    f"{RESULTS}/figures/{name}.{suffix}" for name in outputs.figures for suffix in ("pdf", "svg", "png")
]
SENSOR_FIGURES = [file for file in FIGURES if figure_entry(Path(file).stem).category == "Sensor"]
