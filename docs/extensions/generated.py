"""A directive whose text is generated while the site is built."""

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import nested_parse_with_titles


class Generated(SphinxDirective):
    """Parses the reStructuredText that `text` returns, with its headings."""

    optional_arguments, final_argument_whitespace = 1, True

    def text(self) -> str:
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        lines = StringList(self.text().splitlines(), source=self.env.docname)
        node = nodes.container()
        node.document = self.state.document
        nested_parse_with_titles(self.state, lines, node)
        return node.children
