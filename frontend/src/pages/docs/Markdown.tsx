/** Renders a document as elements; the text of the document never becomes HTML. */

import type { Token, Tokens } from "marked";
import { Fragment, type ReactNode } from "react";
import { Link } from "wouter";
import { fillText } from "../../samples/texts";
import styles from "./Docs.module.css";
import { plain, routeOf } from "./documents";
import { TEXTS } from "./texts";

interface MarkdownProps {
  /** Name of the document, which resolves its relative links. */
  readonly of: string;
  readonly tokens: readonly Token[];
}

export function Markdown({ of, tokens }: MarkdownProps) {
  // biome-ignore lint/suspicious/noArrayIndexKey: a document is read once and never changes
  return tokens.map((token, index) => <Fragment key={index}>{drawn(of, token as Tokens.Generic)}</Fragment>);
}

function drawn(of: string, token: Token): ReactNode {
  const within = "tokens" in token && token.tokens ? <Markdown of={of} tokens={token.tokens} /> : null;
  switch (token.type) {
    case "space":
    case "def":
    case "html": // a comment for the authors
      return null;
    case "paragraph":
      return <p>{within}</p>;
    case "strong":
      return <strong>{within}</strong>;
    case "em":
      return <em>{within}</em>;
    case "del":
      return <del>{within}</del>;
    case "br":
      return <br />;
    case "hr":
      return <hr />;
    case "blockquote":
      return <blockquote>{within}</blockquote>;
    case "codespan":
      return <code>{token.text}</code>;
    case "code":
      return (
        // biome-ignore lint/a11y/noNoninteractiveTabindex: the keyboard scrolls content that is wider than the page
        <pre tabIndex={0}>
          <code>{token.text}</code>
        </pre>
      );
    case "list":
      return list(of, token as Tokens.List);
    case "table":
      return table(of, token as Tokens.Table);
    case "link":
      return link(of, token as Tokens.Link, within);
    case "escape":
      return token.text;
    case "text":
      return within ?? token.text;
    default: // a kind that no document contains: its source text
      return token.raw;
  }
}

function list(of: string, { ordered, start, items }: Tokens.List): ReactNode {
  const rows = items.map((item, index) => (
    // biome-ignore lint/suspicious/noArrayIndexKey: a document is read once and never changes
    <li key={index}>
      <Markdown of={of} tokens={item.tokens} />
    </li>
  ));
  return ordered ? <ol start={start || 1}>{rows}</ol> : <ul>{rows}</ul>;
}

function table(of: string, { header, rows }: Tokens.Table): ReactNode {
  return (
    <section
      className={styles.wide}
      // biome-ignore lint/a11y/noNoninteractiveTabindex: the keyboard scrolls content that is wider than the page
      tabIndex={0}
      aria-label={fillText(TEXTS.table, { columns: header.map((cell) => plain(cell.tokens)).join(", ") })}
    >
      <table>
        <thead>
          <tr>
            {header.map((cell, index) => (
              // biome-ignore lint/suspicious/noArrayIndexKey: a document is read once and never changes
              <th key={index} scope="col">
                <Markdown of={of} tokens={cell.tokens} />
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {rows.map((row, place) => (
            // biome-ignore lint/suspicious/noArrayIndexKey: a document is read once and never changes
            <tr key={place}>
              {row.map((cell, index) => (
                // biome-ignore lint/suspicious/noArrayIndexKey: a document is read once and never changes
                <td key={index} style={{ textAlign: cell.align ?? undefined }}>
                  <Markdown of={of} tokens={cell.tokens} />
                </td>
              ))}
            </tr>
          ))}
        </tbody>
      </table>
    </section>
  );
}

/** Renders a link to a document or page, an external address in a new tab, or the text of any other target. */
function link(of: string, { href }: Tokens.Link, within: ReactNode): ReactNode {
  if (href.startsWith("#/")) return <Link href={href.slice(1)}>{within}</Link>;
  const route = routeOf(of, href);
  if (route !== null) return <Link href={route}>{within}</Link>;
  if (!/^https?:/.test(href)) return within;
  return (
    <a href={href} target="_blank" rel="noreferrer">
      {within}
    </a>
  );
}
