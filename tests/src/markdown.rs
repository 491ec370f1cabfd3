//! What a Markdown text holds, as its readers see it.

use std::collections::BTreeSet;

use markdown::ParseOptions;
use markdown::mdast::Node;

/// What `of` says of each of its nodes, in their order.
fn each<T>(text: &str, of: impl Fn(&Node) -> Option<T>) -> Vec<T> {
    fn walk<T>(node: &Node, of: &impl Fn(&Node) -> Option<T>, found: &mut Vec<T>) {
        found.extend(of(node));
        node.children().into_iter().flatten().for_each(|child| walk(child, of, found));
    }
    let mut found = Vec::new();
    let tree = markdown::to_mdast(text, &ParseOptions::gfm()).expect("every text is Markdown");
    walk(&tree, &of, &mut found);
    found
}

/// Targets of its links and pictures.
pub fn links(text: &str) -> Vec<String> {
    each(text, |node| match node {
        Node::Link(link) => Some(link.url.clone()),
        Node::Image(image) => Some(image.url.clone()),
        _ => None,
    })
}

/// Names by which links lead to its headings: in small letters, words joined by hyphens, without other signs.
pub fn anchors(text: &str) -> BTreeSet<String> {
    let name = |heading: &Node| {
        let words = heading.to_string().to_lowercase().replace(' ', "-");
        words.chars().filter(|c| c.is_alphanumeric() || "-_".contains(*c)).collect()
    };
    each(text, |node| matches!(node, Node::Heading(_)).then(|| name(node))).into_iter().collect()
}

/// What it sets as code within its lines.
pub fn code(text: &str) -> Vec<String> {
    each(text, |node| if let Node::InlineCode(code) = node { Some(code.value.clone()) } else { None })
}

/// Its fenced blocks of code in a language; what they say behind the language is part of that.
pub fn blocks<'a>(text: &'a str, language: &str) -> Vec<&'a str> {
    each(text, |node| {
        let Node::Code(block) = node else { return None };
        let said = [block.lang.as_deref()?, block.meta.as_deref().unwrap_or_default()].join(" ");
        let at = block.position.as_ref().filter(|_| said.trim_end() == language)?;
        let (_, rest) = text[at.start.offset..at.end.offset].split_once('\n')?;
        Some(rest.rsplit_once('\n').map_or("", |(code, _)| code))
    })
}
