"""The steps of the benchmark: one module for each rule of the workflow, with the rule's name.

``python -m puckbench.steps NAME SETTINGS key=FILE ...`` runs a step.
"""
