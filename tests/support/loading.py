"""Loading a script of scripts/ as a module, so that tests can call its `main`."""

import importlib.util

from tests.support.places import SCRIPTS


def script(name):
    """The module of scripts/<name>.py."""
    specification = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module
