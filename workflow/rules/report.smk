# The page of a run: every table and figure that rules mark for reports, under its caption.


rule write_report:
    input:
        made=read_by_report,
        captions=lambda w: sorted({file["caption"] for file in shown_in_report()}),
        template=os.path.relpath(PACKAGE / "evaluation" / "report" / "page.html"),
    output:
        results("report.html"),
    log:
        results("logs/report.log"),
    resources:
        mem_mb=1000,
    params:
        software=software("report"),
        settings=report_settings,
        results=lambda w, output: os.path.dirname(output[0]),
    message:
        "put tables, figures, costs and provenance on a page"
    shell:
        command("report", "params.results output")
