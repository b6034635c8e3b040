/** What differs between two experiments, in words: parts that came and went, values that changed. Pure. */

import type { Angles } from "../../samples/quantity";
import type { Bound, Document, Part } from "./document";
import { innerOf } from "./document";
import { partInWords } from "./PartList";

const MOST = 6;

/** From one to the other; empty where nothing differs. */
export function differences(from: Document, to: Document, angles: Angles): string[] {
  const words = [
    ...(from.title === to.title ? [] : [`title “${from.title}” is “${to.title}”`]),
    ...ofLists(lines(from, angles), lines(to, angles)),
    ...ofLists(from.criteria?.map(boundLine) ?? [], to.criteria?.map(boundLine) ?? []),
    ...Object.keys({ ...from, ...to })
      .filter((name) => !["name", "title", "phases", "criteria"].includes(name))
      .filter((name) => JSON.stringify(from[name]) !== JSON.stringify(to[name]))
      .map((name) => `${name} changed`),
  ];
  return words.length <= MOST ? words : [...words.slice(0, MOST), `and ${words.length - MOST} more`];
}

/** Each part with the loops that it lies in. */
function lines(document: Document, angles: Angles): string[] {
  const of = (parts: readonly Part[], indent: string): string[] =>
    parts.flatMap((part) => [
      indent + partInWords(part, angles),
      ...innerOf(part).flatMap(([, inner]) => of(inner, `${indent}in a loop: `)),
    ]);
  return document.phases.flatMap((phase) => [`phase ${phase.title}`, ...of(phase.parts, "")]);
}

function boundLine({ figure, below, above }: Bound): string {
  return below === undefined ? `${figure} above ${above}` : `${figure} below ${below}`;
}

/** What is left out of one list and what is new in the other, by their longest common run. */
function ofLists(from: readonly string[], to: readonly string[]): string[] {
  const common: number[][] = Array.from({ length: from.length + 1 }, () => new Array(to.length + 1).fill(0));
  const held = (i: number, j: number) => common[i]?.[j] ?? 0;
  for (let i = from.length - 1; i >= 0; i -= 1) {
    for (let j = to.length - 1; j >= 0; j -= 1) {
      (common[i] as number[])[j] =
        from[i] === to[j] ? held(i + 1, j + 1) + 1 : Math.max(held(i + 1, j), held(i, j + 1));
    }
  }
  const words: string[] = [];
  let [i, j] = [0, 0];
  while (i < from.length || j < to.length) {
    if (i < from.length && j < to.length && from[i] === to[j]) [i, j] = [i + 1, j + 1];
    else if (j >= to.length || (i < from.length && held(i + 1, j) >= held(i, j + 1)))
      words.push(`without “${from[i++]}”`);
    else words.push(`with “${to[j++]}”`);
  }
  return words;
}
