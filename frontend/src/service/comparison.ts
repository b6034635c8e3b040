/** Runs beside each other: their metrics and settings, their differences, and both as files. */

import { queryOptions } from "@tanstack/react-query";
import type { Stretch } from "../samples/stretch";
import type { operations } from "../wire/api.gen";
import { answered, api } from "../wire/client";
import { excerptOf } from "../wire/curves";
import type { Differences } from "../wire/types";

type Asked = operations["compare_runs"]["parameters"]["query"];

/** Which runs, beside which of them, aligned by what. */
export type ComparisonAsked = Required<Asked> & { readonly reference: number };

export function comparisonQuery(query: ComparisonAsked) {
  return queryOptions({
    queryKey: ["runs", "comparison", query],
    queryFn: () => answered(api.GET("/api/run-comparison", { params: { query } })),
    placeholderData: (before) => before,
  });
}

/** Of a signal over a stretch of the reference; `band` is null where no tolerance is given. */
export function differencesQuery(
  asked: ComparisonAsked,
  signal: string,
  band: number | null,
  points: number,
  stretch?: Stretch,
) {
  const query = { ...asked, signal, points, ...(band === null ? {} : { band }), ...stretch };
  return queryOptions({
    queryKey: ["runs", "differences", query],
    queryFn: () => answered(api.GET("/api/run-comparison/differences", { params: { query } })),
    staleTime: Number.POSITIVE_INFINITY,
    gcTime: 60_000,
  });
}

/** The differences as curves, each called as `named` says; without those that have no name. */
export function curvesOf(found: Differences, named: (run: number) => string | null) {
  const signals = found.runs.flatMap(({ run, minimum, maximum }) => {
    const name = named(run);
    return name === null ? [] : [[name, { unit: found.unit, minimum, maximum }]];
  });
  return excerptOf({ ...found, run: found.reference, signals: Object.fromEntries(signals) });
}

/** Where the comparison is had as text. */
export function comparisonFile(content: "curves" | "table", asked: ComparisonAsked, signal: string): string {
  const { run, ...rest } = asked;
  const words = [...run.map((one) => ["run", one]), ...Object.entries(rest), ["signal", signal]];
  return `./api/run-comparison/${content}.csv?${words.map(([name, value]) => `${name}=${value}`).join("&")}`;
}
