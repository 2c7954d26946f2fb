"""LaTeX itself, for what a paper takes in."""

import shutil
import subprocess


def typeset(folder, body, packages):
    """What pdflatex says of a document; it must be content."""
    program = shutil.which("pdflatex")
    assert program, "no pdflatex is on this machine; apt-get install texlive-latex-recommended"
    packages = "\n".join(f"\\usepackage{{{name}}}" for name in packages)
    body = f"\\begin{{document}}\n{body}\\end{{document}}\n"
    (folder / "a.tex").write_text(f"\\documentclass{{article}}\n{packages}\n{body}")
    done = subprocess.run(
        [program, "-halt-on-error", "-interaction=nonstopmode", "a.tex"],
        cwd=folder,
        capture_output=True,
        text=True,
        errors="replace",
    )
    assert done.returncode == 0, done.stdout[-2000:]
    return done.stdout
