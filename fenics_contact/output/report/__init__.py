"""The report on a result: one page of HTML, or a PDF."""

from fenics_contact.output.report.page import PAGE, report_page, write_report

__all__ = ["PAGE", "report_page", "write_report"]
