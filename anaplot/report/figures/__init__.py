"""Figures of results: drawings of what has been computed; nothing is computed anew.

A function returns None where there is nothing to be drawn. However large the result, a drawing has
a bounded number of marks; what was left out stands under it.
"""
