"""What a person runs: the command line, the study and its report.

main             the command line's door
commands         one module a verb
study, pipeline  the stages from a dataset to a report, and the steps that they share with single commands
report, …        sections of text, tables and figures as one HTML page
"""
