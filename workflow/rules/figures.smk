# Figures: each a rule of its own, so that a change of one figure's style or code draws that one.
for figure, inputs in bench.figures.items():

    rule:
        name:
            figure
        input:
            **inputs,
        output:
            pdf=f"{RESULTS}/figures/{figure}.pdf",
            png=report(
                f"{RESULTS}/figures/{figure}.png",
                category=figure_entry(figure).category,
                labels={"figure": figure_entry(figure).title},
            ),
        params:
            figure=figure,
            inputs=lambda wildcards, input: json.dumps(dict(input.items())),
            style=bench.figure_style(figure),
            code=bench.figure_code(figure),
        resources:
            mem_mb=1500,
            runtime=10,
        log:
            f"{RESULTS}/logs/figures/{figure}.log",
        conda:
            "../../envs/puckbench.yaml"
        shell:
            "python -m puckbench figure {params.figure} {output.pdf} {output.png}"
            " --inputs {params.inputs:q} --style {params.style:q} > {log} 2>&1"


FIGURES = [
    f"{RESULTS}/figures/{figure}.{suffix}" for figure in bench.figures for suffix in ("pdf", "png")
]
SENSOR_FIGURES = [file for file in FIGURES if figure_entry(Path(file).stem).category == "Sensor"]
