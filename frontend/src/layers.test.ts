/** Checks the direction of imports: a folder imports only from itself and from later folders of the list. */

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

/** Imports of each source, relative to the source folder: "service/queries.ts" -> "samples/timeSeries". */
function imports(): [string, string][] {
  return Object.entries(SOURCES).flatMap(([path, text]) => {
    const found = text.matchAll(/(?:from|import) "(\.[^"]*)"/g);
    return [...found].map(([, target]): [string, string] => [
      path.slice(2),
      new URL(target ?? "", `http://page/${path}`).pathname.slice(1),
    ]);
  });
}

test("every folder is in the list and imports only from lower folders", () => {
  const floor = (path: string) => LAYERS.indexOf(path.split("/")[0] ?? "");
  const all = imports();
  expect(all.length).toBeGreaterThan(500);
  expect(Object.keys(SOURCES).filter((path) => floor(path.slice(2)) < 0)).toEqual([]);
  const upward = all.filter(([from, to]) => floor(to) < floor(from));
  expect(upward.map(([from, to]) => `${from} -> ${to}`)).toEqual([]);
});

test("no files import each other in a cycle", () => {
  const files = Object.keys(SOURCES).map((path) => path.slice(2));
  const named = new Map(files.map((file) => [file.replace(/\.tsx?$/, ""), file]));
  const below = new Map<string, string[]>(files.map((file) => [file, []]));
  for (const [from, to] of imports()) {
    const file = named.get(to);
    if (file !== undefined) below.get(from)?.push(file);
  }
  const done = new Set<string>();
  const cycle = (file: string, above: readonly string[]): readonly string[] => {
    if (above.includes(file)) return [...above.slice(above.indexOf(file)), file];
    if (done.has(file)) return [];
    const found = (below.get(file) ?? []).map((next) => cycle(next, [...above, file]));
    done.add(file);
    return found.find((one) => one.length > 0) ?? [];
  };
  expect(files.flatMap((file) => cycle(file, []))).toEqual([]);
});
