/** The samples of stored runs as sources of curves, in more detail where the view has come to rest. */

import { useDebouncedValue } from "@mantine/hooks";
import { useEffect, useMemo } from "react";
import { RecordedSource } from "../../charts/recordedSource";
import { stretch, type Viewport } from "../../charts/viewport";
import { significant } from "../../samples/format";
import type { Stretch } from "../../samples/stretch";
import { usePanels } from "../../theme/usePanels";
import type { Excerpt } from "../../wire/curves";
import { useExcerpts } from "./useExcerpts";

/** What the drawing of the actuator and the foot of a picture need, whatever the charts show. */
const ALWAYS = ["q", "q_ref", "S", "theta_A", "theta_B", "F_A", "F_B", "lam_q", "lam_S", "bank_entry"];
const POINTS = 2000;
const RESTED_MS = 80;

export interface Recorded {
  readonly id: number;
  readonly duration_s: number;
  /** What its times are shifted by onto the axis of the charts. */
  readonly offset_s?: number;
}

/** All that the runs cover of the axis. */
export function covered(runs: readonly Recorded[]): Stretch {
  return {
    from_s: Math.min(...runs.map(({ offset_s = 0 }) => offset_s)),
    to_s: Math.max(...runs.map(({ offset_s = 0, duration_s }) => offset_s + duration_s)),
  };
}

export interface Recordings {
  readonly sources: readonly RecordedSource[];
  /** What a point of the curves of the first stands for at present. */
  readonly resolution: string;
}

/** `runs` has to be the same array as long as it says the same. */
export function useRecordings(runs: readonly Recorded[], view: Viewport): Recordings {
  const panels = usePanels();
  const signals = useMemo(() => {
    const drawn = panels.flatMap(({ traces, over }) => [...traces, ...(over === undefined ? [] : [over])]);
    return [...new Set([...drawn.map(({ name }) => name), ...ALWAYS])];
  }, [panels]);
  const sources = useMemo(() => runs.map(({ duration_s }) => new RecordedSource(duration_s)), [runs]);
  const overviews = useExcerpts(
    runs.map(({ id, duration_s }) => ({ id, stretch: { from_s: 0, to_s: duration_s }, wanted: true })),
    POINTS,
    signals,
  );
  const whole = covered(runs);
  const seen = stretch(view, whole.to_s);
  // the first turn of the wheel is followed at once, those after it when they have come to rest
  const wanted = useSteady(widened(seen, whole));
  const [rested] = useDebouncedValue(wanted, RESTED_MS, { leading: true });
  const parts = runs.map(({ duration_s, offset_s = 0 }) => {
    const own = (time_s: number) => Math.min(Math.max(0, time_s - offset_s), duration_s);
    return { from_s: own(rested.from_s), to_s: own(rested.to_s) };
  });
  const zoomed = parts.map(
    ({ from_s, to_s }, index) => to_s - from_s < (runs[index] as Recorded).duration_s && to_s > from_s,
  );
  const details = useExcerpts(
    runs.map(({ id }, index) => ({
      id,
      stretch: parts[index] as Stretch,
      wanted: zoomed[index] === true,
    })),
    2 * POINTS,
    signals,
  );

  useEffect(() => {
    overviews.there.forEach((data, index) => {
      if (data) sources[index]?.setOverview(data);
    });
  }, [overviews.there, sources]);
  // biome-ignore lint/correctness/useExhaustiveDependencies: the data belong to the stretch asked for with them
  useEffect(() => {
    details.there.forEach((data, index) => {
      if (data && zoomed[index]) sources[index]?.setDetail(parts[index] as Stretch, data);
    });
  }, [details.there, sources]);

  const first = parts[0] as Stretch;
  const { duration_s, offset_s = 0 } = runs[0] as Recorded;
  const fits =
    zoomed[0] &&
    first.from_s <= Math.max(0, seen.from_s - offset_s) &&
    first.to_s >= Math.min(seen.to_s - offset_s, duration_s);
  const shown = fits ? details : overviews;
  return { sources, resolution: [resolution(shown.there[0]), shown.lacking].filter(Boolean).join("; ") };
}

/** The same object as long as it says the same: a new one would begin the wait for rest anew. */
function useSteady({ from_s, to_s }: Stretch): Stretch {
  return useMemo(() => ({ from_s, to_s }), [from_s, to_s]);
}

function resolution(shown: Excerpt | undefined): string {
  if (shown === undefined) return "loading";
  return shown.raw ? "every sample" : `smallest and largest per ${significant(shown.width_s, 3)} s`;
}

/** A third more on either side, so that a small pan needs no new data. */
function widened({ from_s, to_s }: Stretch, whole: Stretch): Stretch {
  const margin = (to_s - from_s) / 3;
  return {
    from_s: Math.max(whole.from_s, from_s - margin),
    to_s: Math.max(from_s, Math.min(whole.to_s, to_s + margin)),
  };
}
