import { useHotkeys } from "@mantine/hooks";
import { type RefObject, useCallback, useMemo, useRef, useState, useSyncExternalStore } from "react";
import type { TimeRange } from "../samples/timeSeries";
import type { Panel } from "../theme/signals";

/** Visible time range of the charts: the newest `span_s` seconds, or a fixed range. Pure. */

export interface Viewport {
  readonly span_s: number;
  /** Right edge; null while the view follows the newest sample. */
  readonly end_s: number | null;
}

export const SPANS_S = [5, 10, 20, 30, 60, 120] as const;
const DEFAULT_SPAN_S = 20;
const SHORTEST_SPAN_S = 0.02;
const LONGEST_SPAN_S = SPANS_S[SPANS_S.length - 1] as number;

export const LIVE: Viewport = { span_s: DEFAULT_SPAN_S, end_s: null };

/** Visible range when the newest sample is at `now_s`. */
export function visibleRange(view: Viewport, now_s: number): TimeRange {
  const to_s = view.end_s ?? now_s;
  return { from_s: to_s - view.span_s, to_s };
}

/** Scales the span by `factor`. The time `at_s` keeps its position; a following view keeps its right edge. */
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

/** Moves the view by `shift_s` (positive: later), within the data between `first_s` and `now_s`. */
export function panned(view: Viewport, shift_s: number, first_s: number, now_s: number): Viewport {
  const end_s = (view.end_s ?? now_s) + shift_s;
  const earliest = first_s + 0.1 * view.span_s;
  const latest = now_s + 0.5 * view.span_s;
  return { span_s: view.span_s, end_s: Math.min(Math.max(end_s, Math.min(earliest, latest)), latest) };
}

/** Fixes the current range. */
export function held(view: Viewport, now_s: number): Viewport {
  return { span_s: view.span_s, end_s: view.end_s ?? now_s };
}

/** Sets the span; a fixed view keeps its right edge. */
export function withSpan(view: Viewport, span_s: number): Viewport {
  return { span_s, end_s: view.end_s };
}

/** Follows the newest sample again, with the current span. */
export function following(view: Viewport): Viewport {
  return { span_s: view.span_s, end_s: null };
}

/** View of one stack: React renders it, and the drawing loop reads it without rendering. */

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

/** Position in a recording, set by the pointer on the charts, by a slider, or by playback. */

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
    this.notify();
  }

  play(running: boolean): void {
    this.running = running;
    this.notify();
  }

  private notify(): void {
    for (const listener of this.listeners) listener();
  }
}

export function usePlayhead(playhead: Playhead): { at_s: number; playing: boolean } {
  const at_s = useSyncExternalStore(playhead.subscribe, () => playhead.at_s);
  const playing = useSyncExternalStore(playhead.subscribe, () => playhead.playing);
  return { at_s, playing };
}

/** Returns a stable function for the time of day at time 0, or for null if the axis shows none. */
export function useEpoch(epoch_s: (() => number) | undefined): () => number | null {
  return useCallback(() => epoch_s?.() ?? null, [epoch_s]);
}

/** Shows one panel over time alone, by its button or by Enter in its chart; Escape shows all. */

interface Enlarged {
  /** Panels to draw: all, or the enlarged one. */
  readonly panels: readonly Panel[];
  /** Title of the enlarged panel; null while all are shown. */
  readonly enlarged: string | null;
  /** Enlarges the panel, or shows all panels if it is already enlarged. */
  enlarge(title: string): void;
}

export function useEnlarged(all: readonly Panel[]): Enlarged {
  const [title, setTitle] = useState<string | null>(null);
  const alone = useMemo(
    () => all.filter((panel) => panel.title === title && panel.over === undefined),
    [all, title],
  );
  const isAlone = alone.length > 0;
  useHotkeys([["Escape", () => setTitle(null), { preventDefault: isAlone }]]);
  return {
    panels: isAlone ? alone : all,
    enlarged: isAlone ? title : null,
    enlarge: (panel) => setTitle(panel === title ? null : panel),
  };
}
