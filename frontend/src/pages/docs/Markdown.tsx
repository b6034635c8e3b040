/** A document as elements of the page: what was read stays text, nothing of it becomes markup of its own. */

import type { Token, Tokens } from "marked";
import { Fragment, type ReactNode } from "react";
import { Link } from "wouter";
import { fillText } from "../../samples/texts";
import styles from "./Docs.module.css";
import { plain, routeOf } from "./documents";
import { TEXTS } from "./texts";

interface MarkdownProps {
  /** Name of the document, for where its links lead. */
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
    case "html": // a comment for who writes it
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
        // biome-ignore lint/a11y/noNoninteractiveTabindex: what is wider than the page is scrolled with the keyboard too
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
    default: // a kind that no document has: its text, as it was written
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
      // biome-ignore lint/a11y/noNoninteractiveTabindex: what is wider than the page is scrolled with the keyboard too
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

/** To a document or a page of the dashboard; an address outside in a tab of its own; what is neither stays words. */
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
