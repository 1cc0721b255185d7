# Figures.
figure = rules_of("figure", "figures/{figure}")


rule figure:
    input:
        unpack(figure.inputs),
    output:
        pdf=f"{RESULTS}/figures/{{figure}}.pdf",
        svg=f"{RESULTS}/figures/{{figure}}.svg",
        png=report(
            f"{RESULTS}/figures/{{figure}}.png",
            category=lambda w: figure_entry(w.figure).category,
            labels=lambda w: {"figure": figure_entry(w.figure).title},
        ),
    log:
        figure.log,
    wildcard_constraints:
        figure=one_of(flow.outputs.drawable),
    conda:
        "../../envs/puckbench.yaml"
    resources:
        mem_mb=figure.memory_mb,
        runtime=figure.minutes,
    params:
        settings=figure.settings,
        key=figure.key,
        inputs=lambda w, input: words_of(input, flow.outputs.drawable[w.figure]),
    shell:
        "python -m puckbench.steps figure {params.settings} {params.inputs}"
        " out={output.pdf:q} {output.svg:q} {output.png:q} --key={params.key} > {log:q} 2>&1"


# Figures of the first codec's results, drawn early: the jobs that they need have a high priority.
FIRST_FIGURES = [f"{RESULTS}/first_look/{name}.png" for name in flow.outputs.first_figures]
if FIRST_FIGURES:

    first_look = rules_of("first_look", "first_look")

    rule first_look:
        input:
            unpack(first_look.inputs),
        output:
            parquet=f"{RESULTS}/first_look/metrics.parquet",
            images=FIRST_FIGURES,
        log:
            first_look.log,
        priority: 3
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=first_look.memory_mb,
            runtime=first_look.minutes,
        params:
            settings=first_look.settings,
            key=first_look.key,
            results=first_look.folder,
        shell:
            "python -m puckbench.steps first_look {params.settings} results={params.results}"
            " parquet={output.parquet:q} out={output.images:q} --key={params.key} > {log:q} 2>&1"


FIGURES = [
    f"{RESULTS}/figures/{name}.{suffix}"
    for name in flow.outputs.figures
    for suffix in ("pdf", "svg", "png")
]
SENSOR_FIGURES = [file for file in FIGURES if figure_entry(Path(file).stem).category == "Sensor"]
