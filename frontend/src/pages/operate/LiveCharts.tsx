/** The live charts with their buttons. */

import { Button, NativeSelect } from "@mantine/core";
import { useDisclosure, useHotkeys } from "@mantine/hooks";
import { IconPlayerPause, IconPlayerPlay, IconRulerMeasure } from "@tabler/icons-react";
import { useMemo } from "react";
import { Charts } from "../../charts/Charts";
import type { LimitLine, PlacedMark } from "../../charts/decorations";
import { LiveSource } from "../../charts/liveSource";
import { useViewport } from "../../charts/useViewport";
import { following, held, LIVE, SPANS_S, withSpan } from "../../charts/viewport";
import { health } from "../../live/link";
import { useLive, useLiveStore, useNow } from "../../live/react";
import { fixed } from "../../samples/format";
import { DEGREES, FORCE, PANELS, type Panel, POSITION, STIFFNESS, VOLTAGE } from "../../theme/signals";
import { PERIOD_S } from "../../wire/sample.gen";
import type { Limits, Mark } from "../../wire/types";
import styles from "./Operate.module.css";

export function LiveCharts() {
  const store = useLiveStore();
  const source = useMemo(() => new LiveSource(store), [store]);
  const control = useViewport();
  const [measuring, measure] = useDisclosure(false);
  const limits = useLive((live) => live.state?.limits);
  const marks = useLive((live) => live.marks);
  const missed = useLive((live) => live.missed);
  const link = useLive((live) => live.link);
  const stale = health(link, useNow(500)) !== "live";
  const { view, change } = control;
  const isLive = view.end_s === null;

  const pause = () => change(isLive ? held(view, source.now_s()) : following(view));
  useHotkeys([
    ["l", () => change(following(view))],
    ["space", pause],
    ["m", measure.toggle],
  ]);

  return (
    <Charts
      panels={PANELS}
      source={source}
      control={control}
      home={LIVE}
      limits={useMemo(() => limitLines(limits), [limits])}
      marks={useMemo(() => marks.map(placed).sort((a, b) => a.time_s - b.time_s), [marks])}
      measuring={measuring}
      stale={stale}
    >
      <div className={styles.toolbar}>
        <NativeSelect
          aria-label="Window"
          value={String(view.span_s)}
          onChange={(event) => change(withSpan(view, Number(event.currentTarget.value)))}
          data={spanChoices(view.span_s)}
          w={92}
        />
        <Button
          variant={isLive ? "filled" : "default"}
          aria-pressed={isLive}
          onClick={() => change(following(view))}
        >
          Live
        </Button>
        <Button
          variant="default"
          leftSection={isLive ? <IconPlayerPause size={14} /> : <IconPlayerPlay size={14} />}
          onClick={pause}
          w={96}
        >
          {isLive ? "Hold" : "Go on"}
        </Button>
        <Button
          variant={measuring ? "light" : "default"}
          aria-pressed={measuring}
          leftSection={<IconRulerMeasure size={14} />}
          onClick={measure.toggle}
        >
          Measure
        </Button>
        <output className={styles.deltaTime} data-role="delta-t" hidden={!measuring} />
        <span className={styles.toolbarEnd}>
          {missed > 0 && `${missed} samples missed · `}
          {isLive ? "following" : "held"} · {fixed(view.span_s, view.span_s < 1 ? 3 : 1)} s in sight
        </span>
      </div>
    </Charts>
  );
}

function spanChoices(span_s: number): { value: string; label: string }[] {
  const spans: number[] = [...SPANS_S];
  const choices = spans.map((value) => ({ value: String(value), label: `${value} s` }));
  const free = { value: String(span_s), label: `${fixed(span_s, span_s < 10 ? 2 : 0)} s` };
  return spans.includes(span_s) ? choices : [free, ...choices];
}

function placed(mark: Mark): PlacedMark {
  return { time_s: mark.tick * PERIOD_S, text: mark.text, fault: mark.kind === "fault" };
}

function limitLines(limits: Limits | undefined): ReadonlyMap<Panel, readonly LimitLine[]> {
  if (limits === undefined) return new Map();
  const { q_min, q_max, S_min, S_max, F_min, F_max, u_max } = limits;
  const line = (value: number, label: string, alwaysInSight = false): LimitLine => ({
    value,
    label,
    alwaysInSight,
  });
  return new Map<Panel, readonly LimitLine[]>([
    [POSITION, [line(q_min * DEGREES, "lowest q_ref"), line(q_max * DEGREES, "highest q_ref")]],
    [STIFFNESS, [line(S_min, "lowest S_ref"), line(S_max, "highest S_ref")]],
    [
      FORCE,
      [line(F_min, `slack ${fixed(F_min, 0)} N`, true), line(F_max, `limit ${fixed(F_max, 0)} N`, true)],
    ],
    [VOLTAGE, [line(-u_max, `−${fixed(u_max, 0)} V`, true), line(u_max, `+${fixed(u_max, 0)} V`, true)]],
  ]);
}
