/** Choice of a second run for the same axes. */

import { NativeSelect } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useLocation } from "wouter";
import { dateTime } from "../../samples/format";
import { inWordsOf } from "../../samples/words";
import { runsQuery } from "../../service/queries";
import type { Run } from "../../wire/types";

const OFFERED = 100;

export function CompareWith({ run, other }: { run: Run; other: number | undefined }) {
  const [, go] = useLocation();
  const runs = useQuery(runsQuery({ kind: "", search: "", limit: OFFERED, offset: 0 }));
  const offered = (runs.data?.runs ?? []).filter(({ id, samples }) => id !== run.id && samples > 0);
  // those of the same kind come first: they are what one compares with
  const sorted = [...offered].sort((a, b) => Number(b.kind === run.kind) - Number(a.kind === run.kind));
  const missing = other !== undefined && !offered.some(({ id }) => id === other);
  return (
    <NativeSelect
      aria-label="Compare with"
      value={other === undefined ? "" : String(other)}
      onChange={(event) => {
        const chosen = event.currentTarget.value;
        go(chosen === "" ? `/runs/${run.id}` : `/runs/${run.id}/${chosen}`);
      }}
      data={[
        { value: "", label: "Compare with …" },
        ...(missing ? [{ value: String(other), label: `run ${other}` }] : []),
        ...sorted.map(({ id, kind, started }) => ({
          value: String(id),
          label: `run ${id}, ${inWordsOf(kind)}, ${dateTime(started)}`,
        })),
      ]}
    />
  );
}
