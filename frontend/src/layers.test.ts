/** Which way the page's folders import: each only from itself and from those after it in the list. */

import { expect, test } from "vitest";

const LAYERS = [
  "pages",
  "charts",
  "components",
  "theme",
  "service",
  "live",
  "drawing",
  "samples",
  "stop",
  "wire",
];

const SOURCES = import.meta.glob<string>(["./*/**/*.{ts,tsx}", "!./**/*.test.*", "!./**/*.gen.ts"], {
  query: "?raw",
  import: "default",
  eager: true,
});

/** What each source imports of the others, from the folder of sources: "service/queries.ts" -> "samples/stretch". */
function imports(): [string, string][] {
  return Object.entries(SOURCES).flatMap(([path, text]) => {
    const found = text.matchAll(/(?:from|import) "(\.[^"]*)"/g);
    return [...found].map(([, target]): [string, string] => [
      path.slice(2),
      new URL(target ?? "", `http://page/${path}`).pathname.slice(1),
    ]);
  });
}

test("every folder has its place, and imports only what lies below it", () => {
  const floor = (path: string) => LAYERS.indexOf(path.split("/")[0] ?? "");
  const all = imports();
  expect(all.length).toBeGreaterThan(500);
  expect(Object.keys(SOURCES).filter((path) => floor(path.slice(2)) < 0)).toEqual([]);
  const upward = all.filter(([from, to]) => floor(to) < floor(from));
  expect(upward.map(([from, to]) => `${from} -> ${to}`)).toEqual([]);
});

test("no files import each other in a circle", () => {
  const files = Object.keys(SOURCES).map((path) => path.slice(2));
  const named = new Map(files.map((file) => [file.replace(/\.tsx?$/, ""), file]));
  const below = new Map<string, string[]>(files.map((file) => [file, []]));
  for (const [from, to] of imports()) {
    const file = named.get(to);
    if (file !== undefined) below.get(from)?.push(file);
  }
  const done = new Set<string>();
  const circle = (file: string, above: readonly string[]): readonly string[] => {
    if (above.includes(file)) return [...above.slice(above.indexOf(file)), file];
    if (done.has(file)) return [];
    const found = (below.get(file) ?? []).map((next) => circle(next, [...above, file]));
    done.add(file);
    return found.find((one) => one.length > 0) ?? [];
  };
  expect(files.flatMap((file) => circle(file, []))).toEqual([]);
});
