/** λ of both outer loops, what they would do at the value in hand, and what differs from what was saved. */

import { Checkbox } from "@mantine/core";
import { Fragment, useState } from "react";
import { Shown } from "../../components/Absent";
import { Card } from "../../components/Card";
import { Explained } from "../../components/Explained";
import { MotorMargins } from "../../components/MotorMargins";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { type Angles, told } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { useSetTuning } from "../../service/commands";
import { useNoRetuning } from "../../service/useNoControl";
import { type Previewed, usePreview, usePreviewedStiffness } from "../../service/usePreview";
import { type LambdaName, useStagedTuning } from "../../service/useStagedTuning";
import { HUES } from "../../theme/signals";
import type { PreviewedStep, Tuning, TuningPreview } from "../../wire/types";
import { DisturbanceFeedforwardControl } from "./DisturbanceFeedforwardControl";
import { LambdaControl } from "./LambdaControl";
import styles from "./Operate.module.css";
import { TuningChanges } from "./TuningChanges";

const LAMBDAS = [
  { name: "lam_q", symbol: "λ_q", hue: HUES.q, loop: "position", step: "q" },
  { name: "lam_S", symbol: "λ_S", hue: HUES.S, loop: "stiffness", step: "S" },
] as const;

export function TuningCard() {
  const tuning = useLive((live) => live.state?.tuning);
  const u_max = useLive((live) => live.state?.limits.u_max ?? 0);
  return (
    <Card title="Tuning" aside={<ActiveBank tuning={tuning} />}>
      {tuning ? <Lambdas tuning={tuning} u_max={u_max} /> : <div className={styles.reserveTuning} />}
    </Card>
  );
}

function Lambdas({ tuning, u_max }: { tuning: Tuning; u_max: number }) {
  const setTuning = useSetTuning();
  const locked = useNoRetuning();
  const staged = useStagedTuning();
  const [compare, setCompare] = useState(false);
  const [drafts, setDrafts] = useState<{ [Name in LambdaName]?: number | undefined }>({});
  const wanted = (name: LambdaName) => staged.values[name] ?? tuning[name];
  const [shareDraft, setShareDraft] = useState<number>();
  const { motion, u_plan, k_ext } = tuning;
  const S = usePreviewedStiffness();
  const previewed = usePreview(
    {
      lam_q: drafts.lam_q ?? wanted("lam_q"),
      lam_S: drafts.lam_S ?? wanted("lam_S"),
      motion,
      u_plan,
      k_ext: shareDraft ?? k_ext,
      S,
      printed: compare,
    },
    tuning,
  );
  const present = usePreview(
    { lam_q: tuning.lam_q, lam_S: tuning.lam_S, motion, u_plan, k_ext, S, printed: false },
    tuning,
  );
  return (
    <>
      {LAMBDAS.map(({ name, symbol, hue, loop, step }) => (
        <Fragment key={name}>
          <LambdaControl
            name={name}
            symbol={symbol}
            hue={hue}
            tuning={tuning}
            value={wanted(name)}
            loop={loop}
            previewed={previewed}
            present={present.preview}
            compare={compare}
            disabled={locked !== null}
            onDraft={(value) => setDrafts((before) => ({ ...before, [name]: value }))}
            onCommit={async (value) => {
              if (staged.staging) staged.stage(name, value);
              else await setTuning.mutateAsync({ [name]: value });
            }}
          />
          <StepForecast of={step} previewed={previewed} u_max={u_max} />
        </Fragment>
      ))}
      <DisturbanceFeedforwardControl
        tuning={tuning}
        previewed={previewed}
        disabled={locked !== null}
        onDraft={setShareDraft}
        onCommit={(k_ext) => setTuning.mutateAsync({ k_ext })}
      />
      <MotorMargins className={styles.margins} lam_motor={tuning.lam_motor} bank={tuning.bank?.id ?? null} />
      <Checkbox
        size="xs"
        label="Compare with the printed formula (E1)"
        checked={compare}
        onChange={(event) => setCompare(event.currentTarget.checked)}
      />
      <TuningChanges tuning={tuning} staged={staged} locked={locked} />
    </>
  );
}

interface StepForecastProps {
  readonly of: "q" | "S";
  readonly previewed: Previewed;
  readonly u_max: number;
}

/** What a step of one reference takes, and what it asks of motors and tendons. */
function StepForecast({ of, previewed, u_max }: StepForecastProps) {
  const angles = useAngles();
  const { preview, stale, missing } = previewed;
  const step = of === "q" ? preview?.step_q : preview?.step_S;
  const saturates = step !== undefined && step.u_peak_V >= u_max;
  return (
    <output
      className={styles.forecast}
      aria-label={of === "q" ? "Forecast of a 60° step" : "Forecast of a step of S"}
      aria-busy={stale}
      data-stale={stale}
      data-warn={saturates}
    >
      {preview && step ? heading(of, preview, step, angles) : `Step of ${of}`}
      {preview?.motion === "time-optimal" ? " on its trajectory" : ""}: 90 % after{" "}
      <Shown value={step?.rise_s} why={step ? "it does not get there" : missing}>
        {(rise) => fixed(rise, 2)}
      </Shown>{" "}
      s, within 2 % after{" "}
      <Shown value={step?.settling_s} why={step ? "it does not stay there" : missing}>
        {(settling) => fixed(settling, 2)}
      </Shown>{" "}
      s, overshoot{" "}
      <Shown value={step?.overshoot_percent} why={missing}>
        {(overshoot) => fixed(overshoot, 1)}
      </Shown>{" "}
      %, <Explained of="quantity:u_peak_V">peak</Explained>{" "}
      <Shown value={step?.u_peak_V} why={missing}>
        {(u_peak) => fixed(u_peak, 1)}
      </Shown>{" "}
      of {fixed(u_max, 0)} V, <Explained of="quantity:F_min_N">tension</Explained> ≥{" "}
      <Shown value={step?.F_min_N} why={missing}>
        {(F_min) => fixed(F_min, 1)}
      </Shown>{" "}
      N
    </output>
  );
}

function heading(of: "q" | "S", preview: TuningPreview, step: PreviewedStep, angles: Angles): string {
  if (of === "S") return `S from ${fixed(step.start, 1)} to ${fixed(step.end, 1)} N·m/rad`;
  const size = step.end - step.start;
  const size_told = angles === "deg" ? `${fixed((180 * size) / Math.PI, 0)}°` : told(size, "rad", angles);
  return `${size_told} step at S ${fixed(preview.S, 1)} N·m/rad`;
}

function ActiveBank({ tuning }: { tuning: Tuning | undefined }) {
  if (tuning === undefined) return null;
  const { bank, entry_name } = tuning;
  if (bank === null) return <span className={styles.aside}>gains from geometry</span>;
  return (
    <span className={styles.aside}>
      {bank.name} v{bank.version}, {entry_name}
    </span>
  );
}
