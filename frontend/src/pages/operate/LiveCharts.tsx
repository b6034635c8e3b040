import { Button, NativeSelect } from "@mantine/core";
import { useHotkeys } from "@mantine/hooks";
import { useCallback, useEffect, useMemo } from "react";
import { TbPlayerPause, TbPlayerPlay } from "react-icons/tb";
import { Charts } from "../../charts/Charts";
import type { LimitLine, PlacedMark } from "../../charts/decorations";
import type { Origin } from "../../charts/export";
import { LiveSource } from "../../charts/sources";
import { following, held, LIVE, SPANS_S, useViewport, withSpan } from "../../charts/viewport";
import { plantWord } from "../../components/Header";
import { useLive, useLiveStore, useSampleAge } from "../../live/react";
import { age, fixed, short } from "../../samples/format";
import { type AngleUnit, localizeText, readingOf } from "../../samples/quantity";
import { countThings, fillText } from "../../samples/texts";
import { useAngleUnit, usePreferences } from "../../service/api/preferences";
import { usePanels } from "../../theme/useLayouts";
import { PERIOD_S } from "../../wire/sample.gen";
import type { Limits, Mark } from "../../wire/types";
import { TEXTS } from "./texts";

/** Limits of the operator's inputs and of the plant as lines of the charts. Pure. */

const FORCES = ["F_A", "F_B"];
const VOLTAGES = ["u_A", "u_B"];

/** Returns a line per limit, with the signals that it limits; no lines while the limits are unknown. */
export function limitLines(limits: Limits | undefined, angles: AngleUnit): readonly LimitLine[] {
  if (limits === undefined) return [];
  const { q_min, q_max, S_min, S_max, F_min, F_max, u_max } = limits;
  const { factor } = readingOf("rad", angles);
  const line = (of: readonly string[], value: number, label: string, alwaysInSight = false): LimitLine => ({
    of,
    value,
    label,
    alwaysInSight,
  });
  return [
    line(["q", "q_ref"], q_min * factor, fillText(TEXTS.minimum, { signal: "q_ref" })),
    line(["q", "q_ref"], q_max * factor, fillText(TEXTS.maximum, { signal: "q_ref" })),
    line(["S", "S_ref"], S_min, fillText(TEXTS.minimum, { signal: "S_ref" })),
    line(["S", "S_ref"], S_max, fillText(TEXTS.maximum, { signal: "S_ref" })),
    line(FORCES, F_min, fillText(TEXTS.slackLimit, { force: short(F_min) }), true),
    line(FORCES, F_max, fillText(TEXTS.forceLimit, { force: short(F_max) }), true),
    line(VOLTAGES, -u_max, `−${short(u_max)} V`, true),
    line(VOLTAGES, u_max, `+${short(u_max)} V`, true),
  ];
}

/** The live charts with their buttons. */

export function LiveCharts() {
  const store = useLiveStore();
  const source = useMemo(() => new LiveSource(store), [store]);
  const epoch_s = useCallback(() => source.epoch_s(), [source]);
  const control = useViewport();
  const panels = usePanels();
  const angles = useAngleUnit();
  const { preferences, known, change: remember } = usePreferences();
  const limits = useLive((live) => live.state?.limits);
  const origin = useOrigin();
  const marks = useLive((live) => live.marks);
  const missed = useLive((live) => live.missed);
  const old_s = useSampleAge();
  const { view, change, current } = control;
  const isLive = view.end_s === null;

  const home = useMemo(() => ({ ...LIVE, span_s: preferences.window_s }), [preferences.window_s]);
  // restore the person's last time window once their preferences are known
  useEffect(() => {
    if (known && current.current.end_s === null) change(home);
  }, [known, home, change, current]);

  const pause = () => change(isLive ? held(view, source.now_s()) : following(view));
  useHotkeys([
    ["l", () => change(following(view))],
    ["space", pause],
  ]);

  return (
    <Charts
      panels={panels}
      source={source}
      control={control}
      home={home}
      limits={useMemo(() => limitLines(limits, angles), [limits, angles])}
      marks={useMemo(
        () => marks.map((mark) => placed(mark, angles)).sort((a, b) => a.time_s - b.time_s),
        [marks, angles],
      )}
      stale={old_s !== null}
      epoch_s={epoch_s}
      origin={origin}
      name="sinew-live"
      remark={
        <output
          aria-label={TEXTS.view}
          className={old_s === null && missed === 0 ? "visually-hidden" : undefined} // the buttons show the view
        >
          {old_s !== null && `${fillText(TEXTS.valuesOld, { age: age(1000 * old_s) })} `}
          {missed > 0 && `${fillText(TEXTS.samplesMissed, { samples: countThings(missed, "sample") })} `}
          {fillText(isLive ? TEXTS.following : TEXTS.held, {
            span: fixed(view.span_s, view.span_s < 1 ? 3 : 1),
          })}
        </output>
      }
    >
      <NativeSelect
        aria-label={TEXTS.timeWindow}
        value={String(view.span_s)}
        onChange={(event) => {
          const span_s = Number(event.currentTarget.value);
          change(withSpan(view, span_s));
          if (span_s >= (SPANS_S[0] as number)) remember({ window_s: span_s });
        }}
        data={spanChoices(view.span_s)}
        w={80}
      />
      <Button
        px={10}
        variant={isLive ? "filled" : "default"}
        aria-pressed={isLive}
        onClick={() => change(following(view))}
      >
        {TEXTS.live}
      </Button>
      <Button
        variant="default"
        leftSection={isLive ? <TbPlayerPause size={14} /> : <TbPlayerPlay size={14} />}
        onClick={pause}
        w={78}
        px={8}
      >
        {isLive ? TEXTS.hold : TEXTS.resumeCharts}
      </Button>
    </Charts>
  );
}

/** Returns the origin that pictures of the live charts state: run, plant and bank. */
function useOrigin(): Origin {
  const plant = useLive((live) => live.state?.plant.name);
  const run = useLive((live) => live.state?.recording_run);
  const bank = useLive((live) => live.state?.tuning.bank);
  return {
    of: typeof run === "number" ? fillText(TEXTS.originRun, { run }) : TEXTS.originLive,
    plant: plant === undefined ? TEXTS.originPlantUnknown : plantWord(plant),
    bank: bank
      ? fillText(TEXTS.originBank, { bank: bank.name, version: bank.version })
      : TEXTS.originGeometric,
  };
}

function spanChoices(span_s: number): { value: string; label: string }[] {
  const spans: number[] = [...SPANS_S];
  const choices = spans.map((value) => ({ value: String(value), label: `${value} s` }));
  const free = { value: String(span_s), label: `${fixed(span_s, span_s < 10 ? 2 : 0)} s` };
  return spans.includes(span_s) ? choices : [free, ...choices];
}

function placed(mark: Mark, angles: AngleUnit): PlacedMark {
  return {
    time_s: mark.tick * PERIOD_S,
    text: localizeText(mark.text, angles),
    fault: mark.kind === "fault" || mark.kind === "trip",
    mode: mark.kind === "mode",
  };
}
