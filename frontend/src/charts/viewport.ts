import { useHotkeys } from "@mantine/hooks";
import { type RefObject, useCallback, useMemo, useRef, useState, useSyncExternalStore } from "react";
import type { TimeRange } from "../samples/timeSeries";
import type { Panel } from "../theme/signals";

/** Which stretch of time the charts show: the newest `span_s` seconds, or a stretch held still. Pure. */

export interface Viewport {
  readonly span_s: number;
  /** Right edge, or null while the view follows the newest sample. */
  readonly end_s: number | null;
}

export const SPANS_S = [5, 10, 20, 30, 60, 120] as const;
const DEFAULT_SPAN_S = 20;
const SHORTEST_SPAN_S = 0.02;
const LONGEST_SPAN_S = SPANS_S[SPANS_S.length - 1] as number;

export const LIVE: Viewport = { span_s: DEFAULT_SPAN_S, end_s: null };

/** The stretch in sight when the newest sample is at `now_s`. */
export function visibleRange(view: Viewport, now_s: number): TimeRange {
  const to_s = view.end_s ?? now_s;
  return { from_s: to_s - view.span_s, to_s };
}

/** Scale the span by `factor`. The instant `at_s` keeps its place; a view that follows keeps its right edge. */
export function zoomed(
  view: Viewport,
  factor: number,
  at_s: number,
  longest_s: number = LONGEST_SPAN_S,
): Viewport {
  const span_s = Math.min(Math.max(view.span_s * factor, SHORTEST_SPAN_S), longest_s);
  if (view.end_s === null) return { span_s, end_s: null };
  const right = (view.end_s - at_s) / view.span_s;
  return { span_s, end_s: at_s + right * span_s };
}

/** Move the view by `shift_s` (positive: later). It stays where data may be, between `first_s` and `now_s`. */
export function panned(view: Viewport, shift_s: number, first_s: number, now_s: number): Viewport {
  const end_s = (view.end_s ?? now_s) + shift_s;
  const earliest = first_s + 0.1 * view.span_s;
  const latest = now_s + 0.5 * view.span_s;
  return { span_s: view.span_s, end_s: Math.min(Math.max(end_s, Math.min(earliest, latest)), latest) };
}

/** Hold the present stretch still. */
export function held(view: Viewport, now_s: number): Viewport {
  return { span_s: view.span_s, end_s: view.end_s ?? now_s };
}

/** Show another span; a held view keeps its right edge. */
export function withSpan(view: Viewport, span_s: number): Viewport {
  return { span_s, end_s: view.end_s };
}

/** Follow the newest sample again, in the span at hand. */
export function following(view: Viewport): Viewport {
  return { span_s: view.span_s, end_s: null };
}

/** The view of one stack: React shows it, the drawing loop reads it without rendering. */

export interface ViewControl {
  readonly view: Viewport;
  readonly current: RefObject<Viewport>;
  change(to: Viewport): void;
}

export function useViewport(initial: Viewport = LIVE): ViewControl {
  const [view, setView] = useState(initial);
  const current = useRef(initial);
  const change = useCallback((to: Viewport) => {
    current.current = to;
    setView(to);
  }, []);
  return { view, current, change };
}

/** Where a recording is looked at: set by the pointer on the charts, by a slider, or by playing. */

export class Playhead {
  private running = false;
  private readonly listeners = new Set<() => void>();

  constructor(private at = 0) {}

  get at_s(): number {
    return this.at;
  }

  get playing(): boolean {
    return this.running;
  }

  readonly subscribe = (listener: () => void): (() => void) => {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  };

  set(at_s: number): void {
    this.at = at_s;
    this.tell();
  }

  play(running: boolean): void {
    this.running = running;
    this.tell();
  }

  private tell(): void {
    for (const listener of this.listeners) listener();
  }
}

export function usePlayhead(playhead: Playhead): { at_s: number; playing: boolean } {
  const at_s = useSyncExternalStore(playhead.subscribe, () => playhead.at_s);
  const playing = useSyncExternalStore(playhead.subscribe, () => playhead.playing);
  return { at_s, playing };
}

/** The same function as long as the axis tells the same: time of day where there is one, else null. */
export function useEpoch(epoch_s: (() => number) | undefined): () => number | null {
  return useCallback(() => epoch_s?.() ?? null, [epoch_s]);
}

/** One panel over time shown alone: by its button, by Enter in its chart; Escape shows all again. */

interface Enlarged {
  /** What is to be drawn: all panels, or the one that is enlarged. */
  readonly panels: readonly Panel[];
  /** Title of the panel that is shown alone, null while all are shown. */
  readonly enlarged: string | null;
  /** Show the panel alone, or all where it is alone already. */
  enlarge(title: string): void;
}

export function useEnlarged(all: readonly Panel[]): Enlarged {
  const [wanted, setWanted] = useState<string | null>(null);
  const alone = useMemo(
    () => all.filter((panel) => panel.title === wanted && panel.over === undefined),
    [all, wanted],
  );
  const isAlone = alone.length > 0;
  useHotkeys([["Escape", () => setWanted(null), { preventDefault: isAlone }]]);
  return {
    panels: isAlone ? alone : all,
    enlarged: isAlone ? wanted : null,
    enlarge: (title) => setWanted(wanted === title ? null : title),
  };
}
