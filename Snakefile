include: "workflow/Snakefile"


# Snakemake forgets the default target of an included file (its issue 2056).
rule everything:
    default_target: True
    input:
        rules.all.input,
