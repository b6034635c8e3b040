/** Documents of Sinew from its source tree: names, parts, links and search. Pure. */

import { Lexer, type Token, type TokensList } from "marked";
import { TEXTS } from "./texts";

interface Part {
  /** Name in links: lower case, with hyphens for spaces. */
  readonly id: string;
  readonly title: string;
  readonly depth: number;
  readonly tokens: readonly Token[];
  /** Source text of the part. */
  readonly text: string;
}

export interface Document {
  readonly name: string;
  /** Path relative to the root of the sources. */
  readonly path: string;
  readonly title: string;
  readonly parts: readonly Part[];
}

export interface Found {
  readonly document: Document;
  readonly part: Part;
  /** A line that contains one of the words. */
  readonly line: string;
}

const SOURCES = import.meta.glob<string>(
  ["../../../../docs/**/*.md", "../../../../ARCHITECTURE.md", "../../../../CHANGELOG.md"],
  { query: "?raw", import: "default", eager: true },
);
const ROOT = "../../../../";

/** Folders of documents by purpose, in the order of the list. */
export const PURPOSES = {
  tutorial: TEXTS.tutorial,
  "how-to": TEXTS.howTo,
  reference: TEXTS.reference,
  explanation: TEXTS.explanation,
} as const;

type Purpose = keyof typeof PURPOSES;

/** Order within a list; documents without an entry follow in alphabetical order. */
const FIRST = [
  "first-hour",
  "installation",
  "rig",
  "experiments",
  "studies",
  "notebook",
  "exports",
  "reports",
  "network",
  "new-hardware",
  "command-line",
  "notation",
  "faults",
  "search",
  "signals",
  "security",
  "identification",
  "tuning",
  "fidelity",
  "errata",
];

export const DOCUMENTS: readonly Document[] = Object.entries(SOURCES)
  .map(([path, text]) => documentOf(path.slice(ROOT.length), text))
  .sort((a, b) => place(a.name) - place(b.name) || a.name.localeCompare(b.name));

export function documentNamed(name: string): Document | undefined {
  return DOCUMENTS.find((one) => one.name === name);
}

/** Returns the name in addresses: "rig" for `docs/how-to/rig.md`, "decisions/0001-x", "changelog". */
function nameOf(path: string): string {
  const name = path
    .replace(/^docs\//, "")
    .replace(/\.md$/, "")
    .replace(/^([\w-]+)\//, (folder, purpose) => (purpose in PURPOSES ? "" : folder));
  return path.startsWith("docs/") ? name : name.toLowerCase();
}

/** Returns the purpose of a document by its folder; null for decisions, architecture, change log and index. */
export function purposeOf({ path }: Document): Purpose | null {
  const folder = path.split("/")[1] ?? "";
  return folder in PURPOSES ? (folder as Purpose) : null;
}

function place(name: string): number {
  const at = FIRST.indexOf(name);
  if (at >= 0) return at;
  return name.startsWith("decisions/") ? 1000 : 100;
}

export function documentOf(path: string, text: string): Document {
  const name = nameOf(path);
  const tokens: TokensList = new Lexer({ gfm: true }).lex(text);
  const parts: { id: string; title: string; depth: number; tokens: Token[]; text: string }[] = [];
  const ids = new Set<string>();
  for (const token of tokens) {
    if (token.type === "heading" || parts.length === 0) {
      const title = token.type === "heading" ? plain(token.tokens ?? []) : name;
      const id = unlike(idOf(title), ids);
      parts.push({ id, title, depth: token.type === "heading" ? token.depth : 1, tokens: [], text: "" });
      if (token.type === "heading") continue;
    }
    const part = parts[parts.length - 1];
    part?.tokens.push(token);
    if (part !== undefined) part.text += token.raw;
  }
  return { name, path, title: parts[0]?.title ?? name, parts };
}

function unlike(id: string, ids: Set<string>): string {
  let free = id;
  for (let count = 1; ids.has(free); count += 1) free = `${id}-${count}`;
  ids.add(free);
  return free;
}

function idOf(title: string): string {
  return title
    .toLowerCase()
    .replace(/[^\p{L}\p{N}\s_-]/gu, "")
    .trim()
    .replace(/\s/g, "-");
}

/** Returns the text of tokens, without formatting. */
export function plain(tokens: readonly Token[]): string {
  return tokens
    .map((token) =>
      "tokens" in token && token.tokens ? plain(token.tokens) : "text" in token ? token.text : "",
    )
    .join("");
}

/**
 * Returns the route of a link in a document; null if its target is no document, such as an external address or a source
 * file.
 */
export function routeOf(from: string, href: string): string | null {
  if (/^[a-z]+:/i.test(href)) return null;
  const [path = "", part] = href.split("#");
  const base = new URL(documentNamed(from)?.path ?? "", "file:///");
  const target = new URL(path, base).pathname.slice(1);
  const file = target.endsWith("/") ? `${target}README.md` : target;
  const found = DOCUMENTS.find((one) => one.path === file);
  if (found === undefined) return null;
  return part === undefined ? `/docs/${found.name}` : `/docs/${found.name}/${part}`;
}

/** Splits an address below `/docs/` into the name and the part of a document. */
export function addressed(rest: string): { name: string; part: string | null } {
  const names = DOCUMENTS.map((one) => one.name).filter((one) => rest === one || rest.startsWith(`${one}/`));
  const name = names.sort((a, b) => b.length - a.length)[0] ?? rest;
  return { name, part: rest.length > name.length ? rest.slice(name.length + 1) : null };
}

/** Returns the parts of all documents that contain every word, those with a word in their title first. */
export function search(words: string): readonly Found[] {
  const wanted = words.toLowerCase().split(/\s+/).filter(Boolean);
  if (wanted.length === 0) return [];
  const found = DOCUMENTS.flatMap((document) =>
    document.parts
      .filter((part) => {
        const all = `${document.title} ${part.title} ${part.text}`.toLowerCase();
        return wanted.every((word) => all.includes(word));
      })
      .map((part) => ({ document, part, line: lineWith(part.text, wanted) })),
  );
  const titled = ({ part }: Found) =>
    wanted.some((word) => part.title.toLowerCase().includes(word)) ? 0 : 1;
  return found.sort((a, b) => titled(a) - titled(b));
}

function lineWith(text: string, words: readonly string[]): string {
  const lines = text.split("\n").map((line) => line.trim());
  const line = lines.find((one) => words.some((word) => one.toLowerCase().includes(word))) ?? lines[0] ?? "";
  return line.length > 200 ? `${line.slice(0, 200)} …` : line;
}
