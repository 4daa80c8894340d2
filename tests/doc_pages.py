"""What the pages of the documentation tell a reader to type."""
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
RESULTS = sorted(DOCS.glob("results/*.md"))  # that say how their figures were made
OURS = re.compile(r"(?:build/)?raysfm (?=[-\w])")


def blocks(page):
    """Of its fenced blocks: what it is of, its text."""
    return re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)


def cells(page):
    """What stands as code in its tables."""
    rows = [line for line in page.read_text().splitlines() if line.startswith("|")]
    return [code for row in rows for code in re.findall(r"`([^`]+)`", row)]


def commands(page):
    """What is typed into a shell: the lines of blocks for it, and in tables what has a flag."""
    lines = [line for kind, text in blocks(page) if kind == "sh" for line in text.replace("\\\n", " ").splitlines()]
    typed = [re.split(r"\s#\s", line)[0].strip() for line in lines]
    return [line for line in typed if line] + [code for code in cells(page) if OURS.match(code) and " --" in code]


def mentions(page):
    """What stands as code between words: commands in part, with names in capitals and dots."""
    prose = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return [code for code in re.findall(r"`([^`\n]+)`", prose) if OURS.match(code)]


def whole_mentions(page):
    """Those of them that can be typed as they are: no name in capitals or dots, but for a folder that is made."""
    typed = [code for code in mentions(page) if " --" in code and not code.startswith("raysfm export out ")]
    return [code for code in typed if not re.search(r"\b[A-Z]+\b(?!$)|\.\.\.|\||(?<!--out) [A-Z]+$", code)]


def scripts(page):
    """Scripts of the project that are named as code, with what follows them there."""
    prose = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return [code for code in re.findall(r"`(scripts/[^`\n]+)`", prose) if not code.endswith("/") and "*" not in code]


def misplaced(page):
    """Lines that look like commands and stand where commands() does not look for them."""
    others = [line for kind, text in blocks(page) if kind != "sh" for line in text.splitlines()]
    prose = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    indented = [line for line in prose.splitlines() if line.startswith(("    ", "\t"))]
    looks = re.compile(r"\s*(\$ |(time |sudo )?((build/)?raysfm|scripts/\w+|cmake|colmap|docker) )")
    return [line for line in others + indented if looks.match(line)]
