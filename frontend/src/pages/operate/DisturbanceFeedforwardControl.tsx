/** Pushes that are rejected by feed-forward of the outside force, and what that does to a joint that is pushed. */

import { Switch } from "@mantine/core";
import { useEffect, useState } from "react";
import { Shown } from "../../components/Absent";
import { Refusal } from "../../components/Refusal";
import { ValueBox } from "../../components/ValueBox";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { angleWithUnit } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { fieldEntry } from "../../service/fieldHelp";
import { whyNoEstimate } from "../../service/retuning";
import { useErrorLifetime } from "../../service/useErrorLifetime";
import type { Previewed } from "../../service/usePreview";
import { useSentValue } from "../../service/useSentValue";
import type { Pushed, Tuning } from "../../wire/types";
import styles from "./Operate.module.css";

/** As far as the margin against something stiff allows: beyond, M_s is more than 1/(1 − 0.7) there. */
const USUAL = 0.7;
const STEP = 0.1;
/** The push that is forecast, as long as no forecast says so. */
const PUSH_N = 5;
const DECIMALS = 2;

interface DisturbanceFeedforwardControlProps {
  readonly tuning: Tuning;
  readonly previewed: Previewed;
  /** A run has the tuning: nothing of it is taken. */
  readonly disabled: boolean;
  /** What is in hand and not in force yet, for the forecast. */
  onDraft(k_ext: number | undefined): void;
  onCommit(k_ext: number): Promise<unknown>;
}

export function DisturbanceFeedforwardControl(props: DisturbanceFeedforwardControlProps) {
  const { tuning, previewed, disabled, onDraft, onCommit } = props;
  const { k_ext } = tuning;
  const reason = useLive((live) => whyNoEstimate(live.state));
  const sent = useSentValue(k_ext, onCommit);
  const [problem, setProblem] = useState<string | null>(null);
  const refusal = problem === null ? sent.refusal : null;
  const refused = useErrorLifetime(refusal, k_ext) !== null;
  const rejects = sent.value > 0;
  const angles = useAngles();
  const [typed, setTyped] = useState<number>();
  const drafted = typed ?? (sent.value === k_ext ? undefined : sent.value);

  // biome-ignore lint/correctness/useExhaustiveDependencies: only a new draft is news to the forecast
  useEffect(() => onDraft(drafted), [drafted]);

  return (
    <div className={styles.control}>
      <div className={styles.row}>
        <Switch
          size="xs"
          label="Reject pushes"
          checked={rejects}
          disabled={disabled || (reason !== null && !rejects)}
          title={rejects ? undefined : (reason ?? undefined)}
          onChange={(event) => sent.commit(event.currentTarget.checked ? USUAL : 0)}
        />
        <span className={styles.bounds}>
          {rejects ? "share 0 to 1" : (reason ?? "left to the position loop")}
        </span>
        {rejects && (
          <ValueBox
            label="Share of pushes that is fed forward"
            unit="1"
            value={sent.value}
            decimals={DECIMALS}
            step={STEP}
            width={84}
            disabled={disabled}
            onDraft={setTyped}
            onCommit={sent.commit}
            onProblem={setProblem}
            saidAt="refusal-of-k_ext"
            entry={fieldEntry("tuning.k_ext", angles, { minimum: 0, maximum: 1 })}
            refused={refused}
          />
        )}
      </div>
      <Refusal id="refusal-of-k_ext" error={refusal} about={k_ext} text={problem} />
      <PushForecast previewed={previewed} />
    </div>
  );
}

/**
 * How far and how long a held push moves the joint, and how hard the joint feels; behind the arrows with the rejection.
 * The stiffness S of the springs is what it was: what one feels is force over deviation.
 */
function PushForecast({ previewed }: Pick<DisturbanceFeedforwardControlProps, "previewed">) {
  const angles = useAngles();
  const { preview, stale, missing } = previewed;
  const forecast = preview?.pushed;
  const { without, rejected } = forecast ?? {};
  const both = (word: (push: Pushed["without"]) => string) =>
    without && (rejected ? `${word(without)} → ${word(rejected)}` : word(without));
  const figure = (word: (push: Pushed["without"]) => string) => (
    <Shown value={both(word)} why={missing}>
      {String}
    </Shown>
  );
  return (
    <output
      className={styles.pushForecast}
      aria-label="Forecast of a push"
      aria-busy={stale}
      data-stale={stale}
    >
      {fixed(forecast?.F ?? PUSH_N, 0)} N held: gives way{" "}
      <Shown value={without?.give} why={missing}>
        {(give) => angleWithUnit(give, 1, angles)}
      </Shown>
      , back within {forecast ? angleWithUnit(forecast.near, 1, angles) : "its band"} after{" "}
      {figure(({ back_s }) => (back_s === null ? "never" : `${fixed(back_s, 2)} s`))}; feels like{" "}
      {figure(({ felt_slow }) => fixed(felt_slow, 1))} N·m/rad at 0.1 Hz,{" "}
      {figure(({ felt_fast }) => fixed(felt_fast, 1))} at 1 Hz
    </output>
  );
}
