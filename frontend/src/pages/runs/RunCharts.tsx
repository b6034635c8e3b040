/** The samples of a stored run on the same charts as the live ones. */

import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useMemo } from "react";
import { Charts } from "../../charts/Charts";
import type { PlacedMark } from "../../charts/decorations";
import { RecordedSource } from "../../charts/recordedSource";
import { useViewport } from "../../charts/useViewport";
import { type Stretch, stretch } from "../../charts/viewport";
import { runQuery, samplesQuery } from "../../service/queries";
import { PANELS } from "../../theme/signals";
import page from "../Page.module.css";

const SIGNALS = PANELS.flatMap((panel) => panel.traces.map((trace) => trace.name));
const POINTS = 2000;
const NO_LIMITS = new Map();
const NO_MARKS: readonly PlacedMark[] = [];

export function RunCharts({ run }: { run: number }) {
  const { data, error } = useQuery(runQuery(run));
  if (error) return <p className={page.empty}>{error.message}</p>;
  if (data === undefined) return <p className={page.empty}>Loading …</p>;
  if (data.samples === 0) return <p className={page.empty}>This run has no samples.</p>;
  return <Curves key={data.duration_s} run={run} duration_s={data.duration_s} />;
}

function Curves({ run, duration_s }: { run: number; duration_s: number }) {
  const source = useMemo(() => new RecordedSource(duration_s), [duration_s]);
  const home = useMemo(() => ({ span_s: duration_s, end_s: duration_s }), [duration_s]);
  const control = useViewport(home);
  const all = { from_s: 0, to_s: duration_s };
  const overview = useQuery(samplesQuery(run, all, POINTS, SIGNALS));
  const seen = stretch(control.view, duration_s);
  const [rested] = useDebouncedValue(widened(seen, duration_s), 120);
  const zoomed = rested.to_s - rested.from_s < duration_s;
  const detail = useQuery({ ...samplesQuery(run, rested, 2 * POINTS, SIGNALS), enabled: zoomed });

  useEffect(() => {
    if (overview.data) source.setOverview(overview.data);
  }, [overview.data, source]);
  // biome-ignore lint/correctness/useExhaustiveDependencies: the data belong to the stretch asked for with them
  useEffect(() => {
    if (detail.data && zoomed && !detail.isPlaceholderData) source.setDetail(rested, detail.data);
  }, [detail.data, source]);

  return (
    <Charts
      panels={PANELS}
      source={source}
      control={control}
      home={home}
      longest_s={duration_s}
      limits={NO_LIMITS}
      marks={NO_MARKS}
      measuring={false}
      stale={false}
    />
  );
}

/** A third more on either side, so that a small pan needs no new data. */
function widened({ from_s, to_s }: Stretch, duration_s: number): Stretch {
  const margin = (to_s - from_s) / 3;
  return { from_s: Math.max(0, from_s - margin), to_s: Math.min(duration_s, to_s + margin) };
}
