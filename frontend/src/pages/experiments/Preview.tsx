/** What an experiment that is being composed would give on the simulator, and whether that is of what stands there now. */

import { LocalizedText } from "../../components/LocalizedText";
import { Outcome } from "../../components/Verdict";
import { duration } from "../../samples/format";
import { counted } from "../../samples/words";
import type { CheckedExperiment } from "../../wire/types";
import page from "../Page.module.css";
import { DryRunCurves } from "./DryRunResult";
import { Figures } from "./Figures";
import styles from "./SequenceEditor.module.css";

interface PreviewProps {
  readonly checked: CheckedExperiment | null;
  /** It is of the text that stands there now. */
  readonly current: boolean;
  readonly problem: string | null;
}

export function Preview({ checked, current, problem }: PreviewProps) {
  return (
    <section aria-label="Preview" className={page.fields} aria-busy={!current && problem === null}>
      <output className={page.dim} aria-label="State of the preview">
        {stateOf(checked, current, problem)}
      </output>
      {checked !== null && (
        <div className={current ? page.fields : `${page.fields} ${styles.stale}`}>
          <span>{inWords(checked)}</span>
          {checked.dry_run && (
            <>
              <LocalizedText text={checked.dry_run.message} />
              <Outcome of={checked.dry_run} />
              <Figures criteria={checked.dry_run.criteria} metrics={[]} of="preview" />
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
  if (problem !== null) return checked === null ? "No preview." : "Below: the last one that could be played.";
  if (!current)
    return checked === null ? "Being played …" : "Being played anew; below is what it was before.";
  return checked?.busy
    ? "Waits for a place on the simulator."
    : "Preview of what stands here; nothing moves.";
}

/** What a check came to, in a sentence or two. */
export function inWords(checked: CheckedExperiment): string {
  const parts = [duration(checked.duration_s), counted(checked.parts.length, "part")];
  if (checked.changes_of_tuning > 0)
    parts.push(`${counted(checked.changes_of_tuning, "change")} of the tuning`);
  parts.push(checked.criteria === 1 ? "1 criterion" : `${checked.criteria} criteria`);
  return `${checked.title} can be run: ${parts.join(", ")}. ${peaksInWords(checked)}`;
}

function peaksInWords(checked: CheckedExperiment): string {
  const { peak_voltage_V: volts, min_tension_N: least, max_tension_N: most } = checked;
  if (volts === null || least === null || most === null) {
    return `Its peaks are not known: ${checked.not_predicted || "a dry run did not complete"}.`;
  }
  const [u, low, high] = [volts, least, most].map((figure) => figure.toPrecision(3));
  return `On the simulator: ${u} V at most, tensions ${low} to ${high} N.`;
}
