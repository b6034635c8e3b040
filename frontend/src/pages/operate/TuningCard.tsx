/** λ of both outer loops, what they would do at the value in hand, and what differs from what was saved. */

import { Checkbox } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Shown } from "../../components/Absent";
import { Card } from "../../components/Card";
import { Explained } from "../../components/Explained";
import { MotorMargins } from "../../components/MotorMargins";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { told } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { useSetTuning } from "../../service/commands";
import { previewQuery, tuningKey } from "../../service/queries";
import { whyNoRetuning } from "../../service/retuning";
import { type LambdaName, useStaged } from "../../service/useStaged";
import { HUES } from "../../theme/signals";
import type { Tuning, TuningPreview } from "../../wire/types";
import { LambdaControl } from "./LambdaControl";
import styles from "./Operate.module.css";
import { RejectionControl } from "./RejectionControl";
import { TuningChanges } from "./TuningChanges";

const PREVIEW_AFTER_MS = 60;
/** The step of the forecast [rad]. */
const LARGE_STEP = Math.PI / 3;
const LAMBDAS = [
  { name: "lam_q", symbol: "λ_q", hue: HUES.q, loop: "position" },
  { name: "lam_S", symbol: "λ_S", hue: HUES.S, loop: "stiffness" },
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
  const locked = useLive((live) => whyNoRetuning(live.state));
  const staged = useStaged();
  const [compare, setCompare] = useState(false);
  const [drafts, setDrafts] = useState<{ [Name in LambdaName]?: number | undefined }>({});
  const wanted = (name: LambdaName) => staged.values[name] ?? tuning[name];
  const [lam_q] = useDebouncedValue(drafts.lam_q ?? wanted("lam_q"), PREVIEW_AFTER_MS);
  const [lam_S] = useDebouncedValue(drafts.lam_S ?? wanted("lam_S"), PREVIEW_AFTER_MS);
  const { motion, u_plan } = tuning;
  const [shareDraft, setShareDraft] = useState<number>();
  const [k_ext] = useDebouncedValue(shareDraft ?? tuning.k_ext, PREVIEW_AFTER_MS);
  const key = tuningKey(tuning);
  const preview = useQuery(previewQuery(lam_q, lam_S, motion, u_plan, tuning.k_ext, key));
  const forecast = useQuery(previewQuery(lam_q, lam_S, motion, u_plan, k_ext, key));
  const present = useQuery(previewQuery(tuning.lam_q, tuning.lam_S, motion, u_plan, tuning.k_ext, key));
  const missing = preview.error?.message ?? "being computed";
  return (
    <>
      {LAMBDAS.map(({ name, symbol, hue, loop }) => (
        <LambdaControl
          key={name}
          name={name}
          symbol={symbol}
          hue={hue}
          tuning={tuning}
          value={wanted(name)}
          preview={preview.data?.[loop]}
          missing={missing}
          present={present.data?.[loop]}
          compare={compare}
          disabled={locked !== null}
          onDraft={(value) => setDrafts((before) => ({ ...before, [name]: value }))}
          onCommit={async (value) => {
            if (staged.staging) staged.stage(name, value);
            else await setTuning.mutateAsync({ [name]: value });
          }}
        />
      ))}
      <StepForecast
        preview={forecast.error ? undefined : forecast.data}
        missing={forecast.error?.message ?? "being computed"}
        u_max={u_max}
      />
      <RejectionControl
        tuning={tuning}
        forecast={forecast.error ? undefined : forecast.data?.pushed}
        missing={forecast.error?.message ?? "being computed"}
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
  readonly preview: TuningPreview | undefined;
  /** Why there is no preview where there is none. */
  readonly missing: string;
  readonly u_max: number;
}

/** What a large step would ask of motors and tendons. */
function StepForecast({ preview, missing, u_max }: StepForecastProps) {
  const angles = useAngles();
  const saturates = preview !== undefined && preview.u_peak_V >= u_max;
  return (
    <output className={styles.forecast} aria-label="Forecast of a 60° step" data-warn={saturates}>
      {angles === "deg" ? "60°" : told(LARGE_STEP, "rad", angles)} step:{" "}
      <Explained of="quantity:u_peak_V">peak</Explained>{" "}
      <Shown value={preview?.u_peak_V} why={missing}>
        {(u_peak) => fixed(u_peak, 1)}
      </Shown>{" "}
      of {fixed(u_max, 0)} V, <Explained of="quantity:F_min_N">tension</Explained> ≥{" "}
      <Shown value={preview?.F_min_N} why={missing}>
        {(F_min) => fixed(F_min, 1)}
      </Shown>{" "}
      N, 90 % after{" "}
      <Shown value={preview?.rise_s ?? undefined} why={preview ? "it does not get there" : missing}>
        {(rise) => fixed(rise, 2)}
      </Shown>{" "}
      s
    </output>
  );
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
