/** A signal of each run minus that of the reference, and where it leaves the band that the operator gives. */

import { NativeSelect } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useCallback, useEffect, useMemo } from "react";
import { Charts } from "../../charts/Charts";
import type { PlacedMark } from "../../charts/decorations";
import { RecordedSource } from "../../charts/recordedSource";
import { useViewport } from "../../charts/useViewport";
import { stretch } from "../../charts/viewport";
import { Card } from "../../components/Card";
import { told } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { type ComparisonAsked, curvesOf, differencesQuery } from "../../service/comparison";
import { unitOf } from "../../theme/signals";
import type { Differences } from "../../wire/types";
import page from "../Page.module.css";
import type { Compared } from "./compared";
import { DeviationTable } from "./DeviationTable";
import { bandLines, differencePanel, nameOf, SIGNALS } from "./differencePanel";
import styles from "./Runs.module.css";
import { SettledNumber } from "./SettledNumber";

const POINTS = 2000;
const RESTED_MS = 300;

interface DifferencesCardProps {
  readonly asked: ComparisonAsked;
  /** The runs as the curves above have them, in their order. */
  readonly drawn: readonly number[];
  readonly signal: string;
  /** In SI; null where none is given. */
  readonly band: number | null;
  onChange(to: Partial<Compared>): void;
}

export function DifferencesCard({ asked, drawn, signal, band, onChange }: DifferencesCardProps) {
  const angles = useAngles();
  const { data, error } = useQuery(differencesQuery(asked, signal, band, POINTS));
  return (
    <Card
      title={`Differences to run ${asked.reference}`}
      aside={
        <div className={page.actions}>
          <NativeSelect
            aria-label="Signal"
            value={signal}
            data={SIGNALS.map((name) => ({ value: name, label: name }))}
            onChange={({ currentTarget: { value } }) => onChange({ signal: value, band: null })}
          />
          <SettledNumber
            key={signal}
            label="Tolerance"
            before="±"
            unit={unitOf(signal)}
            value={band}
            optional
            fits={(found) => (found >= 0 ? "" : "is not below 0")}
            onChange={(found) => onChange({ band: found })}
          />
        </div>
      }
    >
      {data === undefined ? (
        <p className={page.empty}>{error?.message ?? "Comparing every sample …"}</p>
      ) : (
        <div className={styles.deviations}>
          <DeviationTable found={data} band={band} />
          {data.runs.some(({ run }) => drawn.includes(run)) && (
            <div className={styles.difference}>
              <DifferenceCharts key={keyOf(asked, signal)} found={data} {...{ asked, drawn, signal, band }} />
            </div>
          )}
          <p className={page.dim}>
            {signal} of each run minus that of run {asked.reference}, at the samples of run {asked.reference}
            {band !== null && `; the band is ± ${told(band, unitOf(signal), angles)}`}.
          </p>
        </div>
      )}
    </Card>
  );
}

function keyOf(asked: ComparisonAsked, signal: string): string {
  return JSON.stringify([asked, signal]);
}

interface DifferenceChartsProps extends Omit<DifferencesCardProps, "onChange"> {
  readonly found: Differences;
}

/** Mounted anew for other runs or another signal. */
function DifferenceCharts({ asked, drawn, signal, band, found }: DifferenceChartsProps) {
  const angles = useAngles();
  const begin_s = found.t[0] ?? 0;
  const end_s = (found.t.at(-1) ?? 0) + found.width_s;
  const home = useMemo(() => ({ span_s: end_s - begin_s, end_s }), [begin_s, end_s]);
  const control = useViewport(home);
  const source = useMemo(() => new RecordedSource(end_s), [end_s]);
  const panel = useMemo(
    () => differencePanel(signal, drawn, asked.reference, angles),
    [signal, drawn, asked.reference, angles],
  );
  const named = useCallback((run: number) => nameOf(signal, drawn, run), [signal, drawn]);
  const [view] = useDebouncedValue(control.view, RESTED_MS);
  const seen = stretch(view, end_s);
  const part = { from_s: Math.max(0, seen.from_s), to_s: Math.max(found.width_s, seen.to_s) };
  const { data: detail } = useQuery({
    ...differencesQuery(asked, signal, null, 2 * POINTS, part),
    enabled: !found.raw && part.to_s - part.from_s < 0.99 * home.span_s,
  });
  useEffect(() => {
    source.setOverview(curvesOf(found, named));
  }, [source, found, named]);
  // biome-ignore lint/correctness/useExhaustiveDependencies: the data belong to the stretch asked for with them
  useEffect(() => {
    if (detail)
      source.setDetail(
        part,
        curvesOf(detail, (run) => nameOf(signal, drawn, run)),
      );
  }, [source, detail, signal, drawn]);
  const marks = useMemo(
    () =>
      found.runs.flatMap(({ run, left_at_s }): PlacedMark[] =>
        left_at_s === null ? [] : [{ time_s: left_at_s, text: `run ${run} leaves`, fault: false }],
      ),
    [found],
  );
  return (
    <Charts
      panels={useMemo(() => [panel], [panel])}
      source={source}
      control={control}
      home={home}
      longest_s={home.span_s}
      limits={useMemo(() => bandLines(panel, band), [panel, band])}
      marks={marks}
      stale={false}
      origin={{ of: `difference of ${signal} to run ${asked.reference}`, plant: "", bank: "" }}
      name={`sinew-difference-to-run-${asked.reference}`}
      remark={found.raw ? "every sample" : "smallest and largest difference"}
    />
  );
}
