/** Set-up of an identification run, with the joint motion to expect before it starts. */

import { Button, NumberInput } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { type FormEvent, useState } from "react";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { Verdict } from "../../components/Verdict";
import { useLive } from "../../live/react";
import { duration, fixed } from "../../samples/format";
import { useStartIdentification } from "../../service/commands";
import { predictionQuery } from "../../service/queries";
import type { IdentificationRequest, Prediction } from "../../wire/types";
import { whyNot } from "../operate/ModeCard";
import page from "../Page.module.css";
import styles from "./Identify.module.css";

type Plan = Omit<IdentificationRequest, "kind">;
type Field = keyof Plan;

const DEFAULT: Plan = { tension_N: 20, amplitude_rad: 1, chip_s: 0.08, bits: 7, periods: 2 };
const NOMINAL_TENSIONS_N = [10, 20, 30, 40];

const FIELDS: readonly { name: Field; label: string; hint: string; step: number }[] = [
  { name: "amplitude_rad", label: "PRBS amplitude [rad]", hint: "added to θ_A,ref, either way", step: 0.1 },
  { name: "chip_s", label: "Chip length [s]", hint: "matched to the loop: 0.08", step: 0.01 },
  { name: "bits", label: "Register bits", hint: "sequence of 2ⁿ − 1 chips", step: 1 },
  { name: "periods", label: "Periods", hint: "whole sequences", step: 1 },
];

export function IdentificationForm({ onStarted }: { onStarted: (id: number) => void }) {
  const [plan, setPlan] = useState<Plan>(DEFAULT);
  const state = useLive((live) => live.state);
  const start = useStartIdentification();
  const [asked] = useDebouncedValue(plan, 300);
  const prediction = useQuery(predictionQuery({ kind: "actuator", ...asked }));
  const busy = state?.task != null;
  const reason = busy ? "Another task is running." : whyNot(state, "identify");

  function set(name: Field, value: number | string): void {
    if (typeof value === "number") setPlan((before) => ({ ...before, [name]: value }));
  }

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (reason === null) {
      start.mutate({ kind: "actuator", ...plan }, { onSuccess: (started) => onStarted(started.id) });
    }
  }

  return (
    <Card title="New identification">
      <form className={page.fields} aria-label="New identification" onSubmit={submit}>
        <div className={styles.tension}>
          <NumberInput
            label="Tension [N]"
            value={plan.tension_N}
            hideControls
            onChange={(value) => set("tension_N", value)}
          />
          <Button.Group>
            {NOMINAL_TENSIONS_N.map((tension) => (
              <Button
                key={tension}
                variant={plan.tension_N === tension ? "light" : "default"}
                aria-label={`Tension ${tension} N`}
                aria-pressed={plan.tension_N === tension}
                onClick={() => set("tension_N", tension)}
                px={10}
                h={30}
              >
                {tension}
              </Button>
            ))}
          </Button.Group>
        </div>
        <div className={styles.grid}>
          {FIELDS.map(({ name, label, hint, step }) => (
            <NumberInput
              key={name}
              label={label}
              description={hint}
              inputWrapperOrder={["label", "input", "description"]}
              value={plan[name]}
              step={step}
              hideControls
              onChange={(value) => set(name, value)}
            />
          ))}
        </div>
        <PredictionView prediction={prediction.data} problem={prediction.error?.message} />
        <Button
          type="submit"
          size="sm"
          aria-disabled={reason !== null}
          data-disabled={reason !== null || undefined}
          loading={start.isPending}
        >
          Start identification
        </Button>
        <Refusal text={start.error?.message ?? reason} />
      </form>
    </Card>
  );
}

function PredictionView({
  prediction,
  problem,
}: {
  prediction: Prediction | undefined;
  problem: string | undefined;
}) {
  return (
    <output className={styles.prediction} aria-label="Prediction">
      {problem !== undefined && <Verdict good={false}>{problem}</Verdict>}
      {problem === undefined && prediction === undefined && <span className={page.dim}>Predicting …</span>}
      {problem === undefined && prediction !== undefined && (
        <>
          <dl className={page.facts}>
            <dt>Joint motion</dt>
            <dd>
              <strong>{fixed(prediction.q_counts, 0)}</strong> encoder counts peak to peak
            </dd>
            <dt>Peak voltage</dt>
            <dd>{fixed(prediction.u_peak_V, 1)} V of 10 V</dd>
            <dt>Least tension</dt>
            <dd>{fixed(prediction.F_min_N, 1)} N</dd>
            <dt>Length</dt>
            <dd>{duration(prediction.duration_s)}</dd>
          </dl>
          <Verdict good={prediction.enough_motion}>{prediction.message}</Verdict>
        </>
      )}
    </output>
  );
}
