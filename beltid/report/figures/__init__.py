"""The charts of the reports; importing it registers them."""

from beltid.report.figures import bench, friction

__all__ = ["bench", "friction"]
