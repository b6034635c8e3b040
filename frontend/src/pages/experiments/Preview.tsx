import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { Outcome } from "../../components/RunState";
import { LocalizedText } from "../../components/values";
import { useLive } from "../../live/react";
import { duration } from "../../samples/format";
import { countThings, fillText } from "../../samples/texts";
import { checkedExperimentQuery, composedPreviewQuery } from "../../service/api/experiments";
import type { CheckedExperiment } from "../../wire/types";
import page from "../Page.module.css";
import { DryRunCurves } from "./DryRun";
import { Figures } from "./ExperimentRuns";
import styles from "./SequenceEditor.module.css";
import { TEXTS } from "./texts";

interface PreviewProps {
  readonly checked: CheckedExperiment | null;
  /** Whether the preview belongs to the current text. */
  readonly current: boolean;
  readonly problem: string | null;
}

/** Shows the simulated result of an edited experiment, and whether it is current. */
export function Preview({ checked, current, problem }: PreviewProps) {
  return (
    <section aria-label={TEXTS.preview} className={page.fields} aria-busy={!current && problem === null}>
      <output className={page.dim} aria-label={TEXTS.previewStatus}>
        {stateOf(checked, current, problem)}
      </output>
      {checked !== null && (
        <div className={current ? page.fields : `${page.fields} ${styles.stale}`}>
          <span>{describeCheck(checked)}</span>
          {checked.dry_run && (
            <>
              <LocalizedText text={checked.dry_run.message} />
              <Outcome of={checked.dry_run} />
              <Figures criteria={checked.dry_run.criteria} metrics={[]} of={TEXTS.previewSource} />
              {checked.dry_run.samples && (
                <DryRunCurves
                  samples={checked.dry_run.samples}
                  duration_s={checked.duration_s}
                  name="sinew-preview"
                />
              )}
            </>
          )}
        </div>
      )}
    </section>
  );
}

function stateOf(checked: CheckedExperiment | null, current: boolean, problem: string | null): string {
  if (problem !== null) return checked === null ? TEXTS.noPreview : TEXTS.lastValidPreview;
  if (!current) return checked === null ? TEXTS.simulatingPreview : TEXTS.updatingPreview;
  return checked?.busy ? TEXTS.previewWaits : TEXTS.previewCurrent;
}

/** Describes the result of a check. */
export function describeCheck(checked: CheckedExperiment): string {
  const parts = [duration(checked.duration_s), countThings(checked.parts.length, TEXTS.partCount)];
  if (checked.changes_of_tuning > 0)
    parts.push(countThings(checked.changes_of_tuning, TEXTS.tuningChangeCount));
  parts.push(countThings(checked.criteria, TEXTS.criterionCount, TEXTS.criteriaCount));
  return fillText(TEXTS.valid, {
    experiment: checked.title,
    contents: parts.join(", "),
    peaks: describePeaks(checked),
  });
}

function describePeaks(checked: CheckedExperiment): string {
  const { peak_voltage_V: volts, min_tension_N: least, max_tension_N: most } = checked;
  if (volts === null || least === null || most === null) {
    return fillText(TEXTS.peaksUnknown, { reason: checked.not_predicted || TEXTS.dryRunIncomplete });
  }
  const [voltage, low, high] = [volts.toPrecision(3), least.toPrecision(3), most.toPrecision(3)];
  return fillText(TEXTS.peaks, { voltage, low, high });
}

/**
 * Preview of an edited text. The page requests it when the text has not changed for `REST_MS`. A check without simulation
 * shows a refusal earlier, also during a simulation. One simulation runs at a time, and to its end: cancelling it would
 * end its worker process, which takes far longer to restart. The next simulation uses the text at that time.
 */

const REST_MS = 600;
const CHECK_MS = 300;

interface ComposedPreview {
  /** Newest preview, which may belong to an earlier text. */
  readonly checked: CheckedExperiment | null;
  /** Whether the preview belongs to this text and was simulated. */
  readonly current: boolean;
  /** Refusal of this text; null if it is unknown. */
  readonly error: Error | null;
}

/** Returns the preview of a text; an empty text has none. */
export function useComposedPreview(text: string): ComposedPreview {
  // the results depend on the active tuning: another one requires a new simulation
  const tuning = useLive(({ state }) => {
    if (state === null) return "";
    const { lam_q, lam_S, lam_motor, b, interpolate, motion, u_plan, k_ext, bank } = state.tuning;
    return JSON.stringify([lam_q, lam_S, lam_motor, b, interpolate, motion, u_plan, k_ext, bank?.id]);
  });
  const [asked, ask] = useState({ text: "", tuning });
  const { data, error, isFetching, isPlaceholderData } = useQuery({
    ...composedPreviewQuery(asked.text, asked.tuning),
    enabled: asked.text !== "",
    placeholderData: keepPreviousData,
  });
  const [rested, rest] = useState("");
  useEffect(() => {
    const timer = setTimeout(() => rest(text), CHECK_MS);
    return () => clearTimeout(timer);
  }, [text]);
  const check = useQuery({ ...checkedExperimentQuery(rested), enabled: rested !== "" });
  const refused = rested === text ? check.error : null;
  const isCurrent = asked.text === text && asked.tuning === tuning;
  useEffect(() => {
    if (isFetching || isCurrent) return;
    const timer = setTimeout(() => ask({ text, tuning }), REST_MS);
    return () => clearTimeout(timer);
  }, [text, tuning, isFetching, isCurrent]);
  return {
    checked: text === "" ? null : (data ?? null),
    current:
      text !== "" && isCurrent && refused === null && data !== undefined && !isPlaceholderData && !data.busy,
    error: text === "" ? null : (refused ?? (isCurrent ? error : null)),
  };
}
