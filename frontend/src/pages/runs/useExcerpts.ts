/** Stretches of recordings, in two parts where they are long: what is summarised comes at once, what follows from every sample later. */

import { useQueries } from "@tanstack/react-query";
import { useMemo, useRef } from "react";
import type { Stretch } from "../../samples/stretch";
import { recordingQuery } from "../../service/queries";
import { isSum } from "../../theme/signals";
import type { Excerpt } from "../../wire/curves";
import { AT_HAND_SAMPLES, PERIOD_S } from "../../wire/sample.gen";

/** Of what is longer [s] every sample is read beside the service: the extremes of a difference come some seconds later. */
export const LONG_S = AT_HAND_SAMPLES * PERIOD_S;

interface Asked {
  readonly id: number;
  readonly stretch: Stretch;
  readonly wanted: boolean;
}

interface Excerpts {
  /** In the order asked for; the same array as long as nothing has come. */
  readonly there: readonly (Excerpt | undefined)[];
  /** What is not there yet or could not be had, in words; "" for nothing. */
  readonly lacking: string;
}

/** `asked` must not change in length. */
export function useExcerpts(asked: readonly Asked[], points: number, signals: readonly string[]): Excerpts {
  const sums = signals.filter(isSum);
  const stored = signals.filter((name) => !isSum(name));
  const apart = asked.map(({ stretch }) => sums.length > 0 && stretch.to_s - stretch.from_s > LONG_S);
  const first = useQueries({
    queries: asked.map(({ id, stretch, wanted }, index) => ({
      ...recordingQuery(id, stretch, points, apart[index] ? stored : signals),
      enabled: wanted,
    })),
  });
  const second = useQueries({
    queries: asked.map(({ id, stretch, wanted }, index) => ({
      ...recordingQuery(id, stretch, points, sums),
      enabled: wanted && apart[index] === true,
    })),
  });
  const joined = asked.map((_, index) => [
    first[index]?.data,
    apart[index] ? second[index]?.data : undefined,
  ]);
  const there = useSame(joined.flat());
  const missing = second.filter((one, index) => apart[index] && asked[index]?.wanted && !one.data);
  return {
    // biome-ignore lint/correctness/useExhaustiveDependencies: what has come decides, not the arrays around it
    there: useMemo(() => joined.map(([a, b]) => together(a, b)), [there]),
    lacking: lackingOf(sums, missing.find((one) => one.error)?.error ?? null, missing.length),
  };
}

/** Both parts of an excerpt as one; a part over other buckets, of a recording that grew meanwhile, is left out. */
export function together(a: Excerpt | undefined, b: Excerpt | undefined): Excerpt | undefined {
  if (a === undefined || b === undefined || a.t.length !== b.t.length || a.t[0] !== b.t[0]) return a;
  return { ...a, signals: { ...a.signals, ...b.signals } };
}

function lackingOf(sums: readonly string[], error: Error | null, missing: number): string {
  const names = sums.map((name) => name.replace(" - ", " − ")).join(", ");
  if (error !== null) return `${names} not computed: ${error.message}`;
  return missing > 0 ? `${names}: being computed from every sample` : "";
}

/** The same array as long as its elements are. */
function useSame<Element>(elements: readonly Element[]): readonly Element[] {
  const kept = useRef(elements);
  const same =
    kept.current.length === elements.length && kept.current.every((one, index) => one === elements[index]);
  if (!same) kept.current = elements;
  return kept.current;
}
