"""The options of the package, each defined once.

A group of options is a TypedDict whose fields are ``Annotated[type, Option(...)]``. From these definitions come the
keyword arguments of `render`, `open`, `Scene` and `Renderer` with their documentation, the options of the command line
with their help, the rules about which mode uses which option, and the reference page ``docs/options.md``.

This module imports nothing, so that `sheetsplat.scene` and `sheetsplat.renderer` may take their own group from here.
"""
