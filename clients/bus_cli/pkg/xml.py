"""`bus pkg xml`: the manifest of a package, or a tag of it."""

from argparse import ArgumentParser, Namespace

from bus_cli.completion import completed_by
from bus_cli.output import CommandError, say, show
from bus_ros import packages


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("package_name", help="The package name"), lambda prefix, **_: packages.names()
    )
    parser.add_argument("-t", "--tag", help="The XML tag to output, e.g. version")


def main(args: Namespace) -> int:
    from xml.etree import ElementTree

    if packages.find_prefix(args.package_name) is None:
        from bus_cli.suggestions import near_package

        raise CommandError(f"Package not found{near_package(args.package_name)}")
    manifest = packages.manifest(args.package_name)
    if manifest is None:
        raise CommandError("Package xml manifest not found")
    try:
        root = ElementTree.parse(manifest).getroot()
    except ElementTree.ParseError as error:
        raise CommandError(f"{manifest} is not XML: {error}") from None
    if args.tag is None:
        say(ElementTree.tostring(root, encoding="unicode"))
        return 0
    elements = root.findall(args.tag)
    if not elements:
        raise CommandError("XML tag not found")
    for element in elements:
        show(element.text, {"tag": args.tag, "text": element.text}, as_json=args.json)
    return 0
