"""Everything that puts a number on an image or a run: check, report, stability, bench, fuzz."""
