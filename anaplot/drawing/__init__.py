"""Drawings as SVG: elements, scales, axes and charts; not what their numbers are about."""
