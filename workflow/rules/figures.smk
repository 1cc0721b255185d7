# Figures: each a rule of its own, so that a change of one figure's style or code draws that one.
for figure, inputs in outputs.figures.items():
    category, title = outputs.figure_labels(figure)

    rule:
        name:
            figure
        input:
            **inputs,
        output:
            pdf=f"{RESULTS}/figures/{figure}.pdf",
            png=report(
                f"{RESULTS}/figures/{figure}.png", category=category, labels={"figure": title}
            ),
        log:
            f"{RESULTS}/logs/figures/{figure}.log",
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=1500,
            runtime=10,
        params:
            record=outputs.figure(figure).record,
            code=outputs.figure(figure).code,
        shell:
            "python -m puckbench.jobs figure {params.record:q} out={output.pdf:q} {output.png:q} > {log:q} 2>&1"


# The first codec's results, drawn as soon as they are there: the jobs that lead to them come first.
FIRST_LOOK = outputs.first_look()
if FIRST_LOOK:

    rule first_look:
        input:
            rows=FIRST_LOOK.files,
        output:
            **FIRST_LOOK.outputs,
        log:
            f"{RESULTS}/logs/first_look.log",
        priority: 2
        conda:
            "../../envs/puckbench.yaml"
        resources:
            mem_mb=1500,
            runtime=10,
        params:
            job=FIRST_LOOK.job.name,
            record=FIRST_LOOK.job.record,
            code=FIRST_LOOK.job.code,
        script:
            "../scripts/job.py"


FIGURES = [
    f"{RESULTS}/figures/{name}.{suffix}" for name in outputs.figures for suffix in ("pdf", "png")
]
SENSOR_FIGURES = [file for file in FIGURES if outputs.figure_labels(Path(file).stem)[0] == "Sensor"]
