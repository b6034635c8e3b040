/** The documents that come with Sinew, as they stand beside its sources: their names, parts, and what leads where. Pure. */

import { Lexer, type Token, type TokensList } from "marked";

export interface Part {
  /** As a link spells it: small letters, hyphens for blanks. */
  readonly id: string;
  readonly title: string;
  readonly depth: number;
  readonly tokens: readonly Token[];
  /** What stands in it, as it was written. */
  readonly text: string;
}

export interface Document {
  readonly name: string;
  readonly title: string;
  readonly parts: readonly Part[];
}

export interface Found {
  readonly document: Document;
  readonly part: Part;
  /** A line in which one of the words stands. */
  readonly line: string;
}

const TEXTS = import.meta.glob<string>(
  ["../../../../docs/**/*.md", "../../../../ARCHITECTURE.md", "../../../../CHANGELOG.md"],
  { query: "?raw", import: "default", eager: true },
);
const ROOT = "../../../../";

/** In the order in which they are offered; what is not named follows by its name. */
const FIRST = [
  "first-hour",
  "identification",
  "tuning",
  "experiments",
  "studies",
  "search",
  "reports",
  "exports",
  "notebook",
  "faults",
  "notation",
  "fidelity",
  "errata",
  "rig",
  "new-hardware",
  "network",
  "security",
];

export const DOCUMENTS: readonly Document[] = Object.entries(TEXTS)
  .map(([path, text]) => documentOf(nameOf(path.slice(ROOT.length)), text))
  .sort((a, b) => place(a.name) - place(b.name) || a.name.localeCompare(b.name));

export function documentNamed(name: string): Document | undefined {
  return DOCUMENTS.find((one) => one.name === name);
}

/** `docs/rig.md` is "rig", `docs/decisions/0001-x.md` is "decisions/0001-x", `CHANGELOG.md` is "changelog". */
function nameOf(path: string): string {
  const name = path.replace(/^docs\//, "").replace(/\.md$/, "");
  return path.startsWith("docs/") ? name : name.toLowerCase();
}

function place(name: string): number {
  const at = FIRST.indexOf(name);
  if (at >= 0) return at;
  return name.startsWith("decisions/") ? 1000 : 100;
}

export function documentOf(name: string, text: string): Document {
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
  return { name, title: parts[0]?.title ?? name, parts };
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

/** What tokens say, without how it looks. */
export function plain(tokens: readonly Token[]): string {
  return tokens
    .map((token) =>
      "tokens" in token && token.tokens ? plain(token.tokens) : "text" in token ? token.text : "",
    )
    .join("");
}

/**
 * Where a link of a document leads: to a page of the dashboard, as a route; null for what is no document of these, as an
 * address outside or a file beside the sources.
 */
export function routeOf(from: string, href: string): string | null {
  if (/^[a-z]+:/i.test(href)) return null;
  const [path = "", part] = href.split("#");
  const folder = from.startsWith("decisions/") ? "docs/decisions/" : isBeside(from) ? "" : "docs/";
  const target = new URL(path === "" ? `${fileOf(from)}` : `/${folder}${path}`, "file:///").pathname.slice(1);
  const name = target.endsWith(".md")
    ? nameOf(target)
    : target === "docs/decisions/"
      ? "decisions/README"
      : "";
  if (documentNamed(name) === undefined) return null;
  return part === undefined ? `/docs/${name}` : `/docs/${name}/${part}`;
}

function isBeside(name: string): boolean {
  return name === "architecture" || name === "changelog";
}

function fileOf(name: string): string {
  return isBeside(name) ? `/${name.toUpperCase()}.md` : `/docs/${name}.md`;
}

/** The name and the part of an address below `/docs/`. */
export function addressed(rest: string): { name: string; part: string | null } {
  const names = DOCUMENTS.map((one) => one.name).filter((one) => rest === one || rest.startsWith(`${one}/`));
  const name = names.sort((a, b) => b.length - a.length)[0] ?? rest;
  return { name, part: rest.length > name.length ? rest.slice(name.length + 1) : null };
}

/** The parts of all documents in which every word stands, those with a word in their title first. */
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
