/** The samples of a stored run as a source of curves, in more detail where the view has come to rest. */

import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useMemo } from "react";
import { RecordedSource } from "../../charts/recordedSource";
import { type Stretch, stretch, type Viewport } from "../../charts/viewport";
import { samplesQuery } from "../../service/queries";
import { PANELS } from "../../theme/signals";

/** What the charts show, and what the drawing of the actuator needs beside. */
const SIGNALS = [...PANELS.flatMap((panel) => panel.traces.map((trace) => trace.name)), "theta_A", "theta_B"];
const POINTS = 2000;
const RESTED_MS = 80;

export function useRecording(run: number, duration_s: number, view: Viewport): RecordedSource {
  const source = useMemo(() => new RecordedSource(duration_s), [duration_s]);
  const overview = useQuery(samplesQuery(run, { from_s: 0, to_s: duration_s }, POINTS, SIGNALS));
  const [rested] = useDebouncedValue(widened(stretch(view, duration_s), duration_s), RESTED_MS);
  const zoomed = rested.to_s - rested.from_s < duration_s;
  const detail = useQuery({ ...samplesQuery(run, rested, 2 * POINTS, SIGNALS), enabled: zoomed });

  useEffect(() => {
    if (overview.data) source.setOverview(overview.data);
  }, [overview.data, source]);
  // biome-ignore lint/correctness/useExhaustiveDependencies: the data belong to the stretch asked for with them
  useEffect(() => {
    if (detail.data && zoomed && !detail.isPlaceholderData) source.setDetail(rested, detail.data);
  }, [detail.data, source]);

  return source;
}

/** A third more on either side, so that a small pan needs no new data. */
function widened({ from_s, to_s }: Stretch, duration_s: number): Stretch {
  const margin = (to_s - from_s) / 3;
  return {
    from_s: Math.max(0, from_s - margin),
    to_s: Math.max(from_s, Math.min(duration_s, to_s + margin)),
  };
}
