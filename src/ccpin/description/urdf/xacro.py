"""xacro files: URDFs with macros, expanded by xacrodoc (the extra ``[xacro]``).

A xacro file is a program: it reads other files and the environment, and its expressions are Python. So only a file that
is one by name (``.xacro``), or of which its reader is told so, is expanded. Its expressions are confined to what xacro
hands them: one that names or reaches for anything that begins with an underscore, the way from a value to its
interpreter, is refused. That stops the ways known, and promises no more: expand only files you trust.
"""

from __future__ import annotations

import ast
import contextlib
import io
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ccpin.description.elements.xml import XmlElement, fail, parse_xml
from ccpin.errors import DescriptionError

SUFFIX = ".xacro"
_NAMESPACE = "xacro"
_FORMATTING = ("format", "format_map")  # of strings: their fields are expressions of another grammar
_ONE_AT_A_TIME = threading.Lock()  # xacro keeps what it expands in module variables


def is_xacro(root: XmlElement) -> bool:
    """Whether a <robot> holds anything that xacro would expand."""
    return any(
        (element.prefix or "") == _NAMESPACE or any("${" in value or "$(" in value for value in element.attrib.values())
        for element in root.iter("*")
    )


def without_xacro(
    root: XmlElement, file: Path, trusted: bool, arguments: Mapping[str, str] | None
) -> tuple[XmlElement, tuple[str, ...]]:
    """A URDF as it is, or as it is once xacro has expanded it, and what xacro said.

    Args:
        root: Its root element.
        file: Its file; packages it finds are looked for in the folders above it and where ROS keeps them.
        trusted: Whether it may be expanded whatever its name ends in.
        arguments: Values of its ``<xacro:arg>`` elements.

    Raises:
        DescriptionError: It holds xacro and may not be expanded; xacrodoc is not installed, or cannot expand it.
        InvalidXmlError: The result is malformed.
    """
    if not is_xacro(root):
        return root, ()
    if not (trusted or file.suffix == SUFFIX):
        raise fail(
            root,
            "the file holds xacro elements or expressions, which are programs: they are run only in a file whose "
            "name ends in .xacro, or where xacro=True (--xacro) says that this one is trusted",
        )
    text, said = _expanded(file, root.get("name") or file.stem, dict(arguments or {}))
    return parse_xml(text, str(file)), tuple(f"xacro: {line}" for line in said)


def _expanded(file: Path, name: str, arguments: dict[str, str]) -> tuple[bytes, list[str]]:
    """The URDF as bytes, and the lines that xacro printed."""
    try:
        from xacrodoc import XacroDoc, packages
    except ImportError as error:  # of the package, or of what it imports itself
        message = (
            f"a xacro file needs the package xacrodoc ({error}): pip install 'ccpin[xacro]' (or give the expanded URDF)"
        )
        raise DescriptionError(message, source=str(file)) from None
    printed = io.StringIO()
    with _ONE_AT_A_TIME, _confined(), contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        try:
            packages.reset()
            packages.walk_up_from(file)
            document = XacroDoc.from_includes(
                [str(file.resolve())], name=name, subargs=arguments, resolve_packages=False
            )
            text = str(document.to_urdf_string())
        except (Exception, SystemExit) as error:  # whatever a macro may raise
            reason = " ".join(str(error).split())[:300] or type(error).__name__
            raise DescriptionError(f"cannot expand the file: {reason}", source=str(file), element="xacro") from None
    return text.encode(), [line.strip() for line in printed.getvalue().splitlines() if line.strip()]


@contextlib.contextmanager
def _confined() -> Iterator[None]:
    """While it lasts xacro's two evaluators, of ``${…}`` and of ``$(eval …)``, refuse what `_refuse_reaching` does."""
    import xacro
    from xacro import substitution_args

    def checked(evaluate: Callable[..., Any]) -> Callable[..., Any]:
        def confined(expression: str, *arguments: Any) -> Any:
            _refuse_reaching(expression)
            return evaluate(expression, *arguments)

        return confined

    of_braces, of_eval = xacro.safe_eval, substitution_args._eval
    xacro.safe_eval, substitution_args._eval = checked(of_braces), checked(of_eval)
    try:
        yield
    finally:
        xacro.safe_eval, substitution_args._eval = of_braces, of_eval


def _refuse_reaching(expression: str) -> None:
    """Nothing, if an expression of Python stays with the values it is given.

    Raises:
        ValueError: It has a name or an attribute that begins with an underscore, or formats a string by its own fields.
        SyntaxError: It is no expression.
    """
    for node in ast.walk(ast.parse(expression.strip(), mode="eval")):
        word = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
        text = node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
        if word.startswith("_") or word in _FORMATTING or "__" in text:
            raise ValueError(f"the expression '{expression.strip()[:80]}' reaches behind its values, which is refused")
