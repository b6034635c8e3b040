/** One λ: slider with its safe range, box, − / + / reset, and the preview of the loop at the value in hand. */

import { ActionIcon, Slider } from "@mantine/core";
import { type ReactNode, useEffect, useState } from "react";
import { TbMinus, TbPlus, TbRestore } from "react-icons/tb";
import { Refusal } from "../../components/Refusal";
import { SignalName } from "../../components/SignalName";
import { TargetKeys } from "../../components/TargetKeys";
import { TouchLock } from "../../components/TouchLock";
import { ValueBox } from "../../components/ValueBox";
import { fixed } from "../../samples/format";
import { useAngles } from "../../service/angles";
import { fieldEntry } from "../../service/fieldHelp";
import { useErrorLifetime } from "../../service/useErrorLifetime";
import type { Previewed } from "../../service/usePreview";
import { useSentValue } from "../../service/useSentValue";
import { LAMBDAS } from "../../wire/sample.gen";
import type { Tuning, TuningPreview } from "../../wire/types";
import styles from "./Operate.module.css";
import type { LoopName } from "./previewedMotion";
import { StepPreview } from "./StepPreview";

const STEP_S = 0.01;
const DECIMALS = 3;
/** Where the scale begins, so that the range that is not offered stays in sight [s]. */
const SCALE_FROM_S = 0.2;
/** One step of the slider: the scale is logarithmic, for most of the work is done at its short end. */
const SLIDER_STEP = 0.01;

interface LambdaControlProps {
  readonly name: "lam_q" | "lam_S";
  readonly symbol: string;
  readonly hue: string;
  readonly tuning: Tuning;
  /** What the control starts from: in force, or staged. */
  readonly value: number;
  readonly loop: LoopName;
  readonly previewed: Previewed;
  /** Of what is in force. */
  readonly present: TuningPreview | undefined;
  readonly compare: boolean;
  /** A run has the tuning: nothing of it is taken. */
  readonly disabled: boolean;
  onDraft(value: number | undefined): void;
  /** Sends the value, or stages it. */
  onCommit(value: number): Promise<unknown>;
}

export function LambdaControl(props: LambdaControlProps) {
  const { name, symbol, hue, tuning, value, loop, previewed, present, compare, disabled, onDraft, onCommit } =
    props;
  const sent = useSentValue(value, onCommit);
  const min = tuning[`${name}_min`];
  const max = tuning[`${name}_max`];
  const [problem, setProblem] = useState<string | null>(null);
  const [proposed, setProposed] = useState(false);
  const target = proposed
    ? `${fixed(sent.value, DECIMALS)} s is not sent yet: Enter takes it, Escape leaves it.`
    : null;
  const refusal = problem === null && target === null ? sent.refusal : null;
  const refused = useErrorLifetime(refusal, value) !== null;
  const drafted = sent.editing ? sent.value : undefined;

  // biome-ignore lint/correctness/useExhaustiveDependencies: only a new draft is news to the preview
  useEffect(() => onDraft(drafted), [drafted]);

  const angles = useAngles();
  const nudge = (by: number) => sent.commit(rounded(sent.value + by));
  const unsafe = (100 * Math.log(min / SCALE_FROM_S)) / Math.log(max / SCALE_FROM_S);
  const fromSlider = (position: number) => Math.min(Math.max(rounded(Math.exp(position)), min), max);

  return (
    <div className={styles.control}>
      <div className={styles.row}>
        <span className={styles.name}>
          <SignalName name={symbol} />
        </span>
        <span className={styles.bounds} />
        <Small name={`Decrease ${symbol}`} disabled={disabled} onClick={() => nudge(-STEP_S)}>
          <TbMinus size={14} />
        </Small>
        <ValueBox
          label={`${symbol} value [s]`}
          unit="s"
          value={sent.value}
          decimals={DECIMALS}
          step={STEP_S}
          width={84}
          disabled={disabled}
          onCommit={sent.commit}
          onProblem={setProblem}
          saidAt={`refusal-of-${name}`}
          entry={fieldEntry(`tuning.${name}`, angles, { minimum: min, maximum: max })}
          refused={refused}
        />
        <Small name={`Increase ${symbol}`} disabled={disabled} onClick={() => nudge(STEP_S)}>
          <TbPlus size={14} />
        </Small>
        <Small
          name={`Reset ${symbol}`}
          disabled={disabled}
          title={`Back to the default, ${LAMBDAS[name]} s`}
          onClick={() => sent.commit(Math.max(LAMBDAS[name], min))}
        >
          <TbRestore size={14} />
        </Small>
      </div>
      <TouchLock name={symbol}>
        <div className={styles.lambdaSlider} style={{ ["--unsafe" as string]: `${unsafe}%` }}>
          <TargetKeys
            min={min}
            max={max}
            step={STEP_S}
            value={sent.value}
            proposed={proposed}
            onPropose={(value) => {
              setProposed(true);
              sent.edit(rounded(value));
            }}
            onCommand={() => {
              setProposed(false);
              sent.commit(Math.min(Math.max(sent.value, min), max));
            }}
            onLeave={() => {
              setProposed(false);
              sent.cancel();
            }}
          >
            <Slider
              thumbLabel={symbol}
              // the value itself: one that was staged may lie below a range that has moved since, where the thumb ends
              thumbValueText={`${fixed(sent.value, DECIMALS)} s`}
              size="sm"
              disabled={disabled}
              domain={[Math.log(SCALE_FROM_S), Math.log(max)]}
              min={Math.log(min)}
              max={Math.log(max)}
              step={SLIDER_STEP}
              precision={4}
              scale={Math.exp}
              value={Math.log(sent.value)}
              label={null}
              onChange={(position) => sent.edit(fromSlider(position))}
              onChangeEnd={(position) => {
                setProposed(false);
                sent.commit(fromSlider(position));
              }}
            />
          </TargetKeys>
          <div className={styles.scale} aria-hidden="true">
            <span style={{ left: `${unsafe}%` }}>{fixed(min, DECIMALS)}</span>
            <span style={{ left: "100%" }}>{fixed(max, 0)} s</span>
          </div>
        </div>
      </TouchLock>
      <StepPreview
        symbol={symbol}
        hue={hue}
        loop={loop}
        preview={previewed.preview}
        stale={previewed.stale}
        missing={previewed.missing}
        present={present}
        drafted={sent.value !== tuning[name]}
        compare={compare}
      />
      <Refusal id={`refusal-of-${name}`} error={refusal} about={value} text={problem ?? target} />
    </div>
  );
}

interface SmallProps {
  readonly name: string;
  readonly title?: string;
  readonly disabled: boolean;
  readonly children: ReactNode;
  onClick(): void;
}

function Small({ name, title, disabled, children, onClick }: SmallProps) {
  return (
    <ActionIcon
      variant="default"
      size={30}
      aria-label={name}
      title={title ?? name}
      disabled={disabled}
      onClick={onClick}
    >
      {children}
    </ActionIcon>
  );
}

function rounded(seconds: number): number {
  return Number(seconds.toFixed(DECIMALS));
}
