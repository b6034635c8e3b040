/** A run beside others: all on one time axis, what differs from one of them, where, and by how much. */

import { useQuery } from "@tanstack/react-query";
import { useMemo } from "react";
import { useLocation } from "wouter";
import { Card } from "../../components/Card";
import { fixed } from "../../samples/format";
import { type ComparisonAsked, comparisonQuery } from "../../service/comparison";
import type { Run, RunComparison } from "../../wire/types";
import page from "../Page.module.css";
import { AlignmentBar } from "./AlignmentBar";
import { addressOf } from "./address";
import { CompareWith } from "./CompareWith";
import { ComparisonCard } from "./ComparisonCard";
import { askedOf, type Compared, textOf } from "./compared";
import { DifferencesCard } from "./DifferencesCard";
import { type Placed, RunCharts } from "./RunCharts";
import styles from "./Runs.module.css";

interface ComparedRunsProps {
  readonly run: Run;
  /** Has to be the same array as long as it says the same. */
  readonly others: readonly number[];
  readonly compared: Compared;
}

export function ComparedRuns({ run, others, compared }: ComparedRunsProps) {
  const [, go] = useLocation();
  const asked = useMemo(() => askedOf([run.id, ...others], compared), [run.id, others, compared]);
  const { data, error, isPlaceholderData } = useQuery(comparisonQuery(asked));
  const told = isPlaceholderData ? undefined : data;
  const placed = usePlaced(asked, told);
  const drawn = useMemo(() => asked.run.filter((id) => placed?.offsets.has(id)), [asked, placed]);
  const change = (to: Partial<Compared>) =>
    go(addressOf(run.id, others, null, textOf({ ...compared, ...to })), { replace: true });
  return (
    <>
      <Card title="Curves" aside={<CompareWith run={run} others={others} how={textOf(compared)} />}>
        <AlignmentBar asked={asked} onChange={change} />
        <p className={styles.placed} aria-live="polite">
          {told === undefined ? (error?.message ?? "Aligning …") : <Placing told={told} />}
        </p>
        <div className={page.charts}>
          {placed === undefined ? (
            <p className={page.empty}>{error === null ? "Loading …" : "Nothing can be drawn."}</p>
          ) : (
            <RunCharts run={run.id} others={others} placed={placed} />
          )}
        </div>
      </Card>
      <DifferencesCard
        asked={asked}
        drawn={drawn}
        signal={compared.signal}
        band={compared.band}
        onChange={change}
      />
      <ComparisonCard asked={asked} signal={compared.signal} told={data} error={error} />
    </>
  );
}

/** From the begin of each run nothing has to be asked for: the curves do not wait. */
function usePlaced(asked: ComparisonAsked, told: RunComparison | undefined): Placed | undefined {
  return useMemo(() => {
    const { reference, by, run } = asked;
    if (by === "begin") return { reference, offsets: new Map(run.map((id) => [id, 0])) };
    if (told === undefined) return undefined;
    const found = told.runs.flatMap(({ id, offset_s }): [number, number][] =>
      offset_s === null ? [] : [[id, offset_s]],
    );
    return { reference, offsets: new Map(found) };
  }, [asked, told]);
}

/** In words how each run came onto the axis, or why it did not. */
function Placing({ told }: { told: RunComparison }) {
  const absent = told.runs.filter(({ not_aligned }) => not_aligned !== "");
  const shifted = told.runs.filter(({ id, offset_s }) => id !== told.reference && offset_s !== null);
  return (
    <>
      Time of run {told.reference}
      {shifted.map(({ id, offset_s }) => (
        <span key={id}>
          {" · "}run {id} {offset_s === 0 ? "not shifted" : `shifted by ${signed(offset_s as number)} s`}
        </span>
      ))}
      {absent.map(({ id, not_aligned }) => (
        <strong key={id} role="alert" className={styles.absent}>
          {" · "}left out: {not_aligned}
        </strong>
      ))}
    </>
  );
}

function signed(value: number): string {
  return value > 0 ? `+${fixed(value, 3)}` : fixed(value, 3);
}
