import type { Token } from "marked";
import { describe, expect, it } from "vitest";
import { STEPS } from "../../components/setup/SetupDrawer";
import {
  addressed,
  DOCUMENTS,
  documentNamed,
  documentOf,
  PURPOSES,
  purposeOf,
  routeOf,
  search,
} from "./documents";

/** Returns all tokens, including nested ones. */
function everything(tokens: readonly Token[]): Token[] {
  return tokens.flatMap((token) => {
    const { tokens: within, items, header, rows } = token as unknown as Record<string, unknown>;
    const cells = [header, ...((rows as unknown[] | undefined) ?? [])].flat() as { tokens: Token[] }[];
    const deeper = [...((items as { tokens: Token[] }[] | undefined) ?? []), ...cells.filter(Boolean)];
    return [
      token,
      ...everything((within as Token[] | undefined) ?? []),
      ...deeper.flatMap((one) => everything(one.tokens)),
    ];
  });
}

const TOKENS = DOCUMENTS.map((one) => ({
  name: one.name,
  tokens: everything(one.parts.flatMap((part) => part.tokens)),
}));

describe("documents", () => {
  it("are complete, and start with the first hour", () => {
    expect(DOCUMENTS.length).toBeGreaterThan(60);
    expect(DOCUMENTS[0]?.name).toBe("first-hour");
    expect(DOCUMENTS.map((one) => one.name)).toEqual(
      expect.arrayContaining(["faults", "tuning", "architecture", "changelog", "decisions/README"]),
    );
    expect(DOCUMENTS.filter((one) => one.title === one.name)).toEqual([]);
  });

  it("have unique names, and a purpose by folder", () => {
    const names = DOCUMENTS.map((one) => one.name);
    expect(new Set(names).size).toBe(names.length);
    expect(purposeOf(documentOf("docs/how-to/x.md", "# X"))).toBe("how-to");
    expect(documentOf("docs/how-to/x.md", "# X").name).toBe("x");
    const used = new Set(DOCUMENTS.map(purposeOf).filter((one) => one !== null));
    expect([...used].sort()).toEqual(Object.keys(PURPOSES).sort());
  });

  it("contain only tokens that the page renders", () => {
    const known = new Set(
      "space def paragraph strong em del br hr blockquote codespan code list table link escape text list_item".split(
        " ",
      ),
    );
    const unknown = TOKENS.flatMap(({ name, tokens }) =>
      tokens
        .filter((token) => !known.has(token.type) && !/^<!--[^>]*-->\s*$/.test(token.raw))
        .map((token) => `${name}: ${token.type} ${token.raw.slice(0, 60)}`),
    );
    expect(unknown).toEqual([]);
  });

  it("contain only links with existing targets", () => {
    const lost = TOKENS.flatMap(({ name, tokens }) =>
      tokens
        .filter((token) => token.type === "link" && !/^(https?:|#\/)/.test(token.href))
        .filter((token) => {
          const href = (token as { href: string }).href;
          const route = routeOf(name, href);
          if (route === null) return /\.md|^#/.test(href);
          const { name: to, part } = addressed(route.slice("/docs/".length));
          const target = documentNamed(to);
          return target === undefined || (part !== null && !target.parts.some((one) => one.id === part));
        })
        .map((token) => `${name}: ${(token as { href: string }).href}`),
    );
    expect(lost).toEqual([]);
  });

  it("are split at their headings, each with a unique address", () => {
    const { title, parts } = documentOf(
      "docs/x.md",
      "# Of `S` and λ_q\n\nFirst.\n\n## Why?\n\nSo.\n\n## Why?\n\nAgain.\n",
    );
    expect(title).toBe("Of S and λ_q");
    expect(parts.map(({ id, depth, text }) => [id, depth, text.trim()])).toEqual([
      ["of-s-and-λ_q", 1, "First."],
      ["why", 2, "So."],
      ["why-1", 2, "Again."],
    ]);
  });
});

describe("first hour", () => {
  it("has a part for each step of the setup", () => {
    const parts = documentNamed("first-hour")?.parts.map((part) => part.id);
    for (const { section } of Object.values(STEPS)) expect(parts).toContain(section);
  });
});

describe("link", () => {
  it("resolves a file to a document, and a fragment to its part", () => {
    expect(routeOf("rig", "../reference/faults.md#a-card-and-its-wires")).toBe(
      "/docs/faults/a-card-and-its-wires",
    );
    expect(routeOf("exports", "../decisions/0045-foxglove-behind-a-door.md")).toBe(
      "/docs/decisions/0045-foxglove-behind-a-door",
    );
    expect(routeOf("decisions/0045-foxglove-behind-a-door", "../how-to/exports.md")).toBe("/docs/exports");
    expect(routeOf("where", "../ARCHITECTURE.md")).toBe("/docs/architecture");
    expect(routeOf("architecture", "docs/where.md")).toBe("/docs/where");
    expect(routeOf("faults", "#a-card-and-its-wires")).toBe("/docs/faults/a-card-and-its-wires");
  });

  it("has no route if it is external or a source file", () => {
    expect(routeOf("rig", "https://example.org/a.md")).toBeNull();
    expect(routeOf("rig", "../../backend/faults.py")).toBeNull();
  });
});

describe("search", () => {
  it("finds the parts that contain all words, in any case", () => {
    const found = search("RELAXATION homing");
    for (const { document, part } of found) {
      const all = `${document.title} ${part.title} ${part.text}`.toLowerCase();
      expect(all).toContain("relaxation");
      expect(all).toContain("homing");
    }
    const many = search("tension");
    expect(many.length).toBeGreaterThan(20);
    for (const { line } of many) expect(line.length).toBeLessThanOrEqual(202);
  });

  it("lists matches in titles first, and finds nothing for an empty text", () => {
    expect(search("notation")[0]?.part.title.toLowerCase()).toContain("notation");
    expect(search("  ")).toEqual([]);
    expect(search("qqqq-there-is-no-such-word")).toEqual([]);
  });
});
