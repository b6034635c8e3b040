/** Set-up of one kind of experiment: start it, queue it, or play it on a simulator first. What it shows is what it sends. */

import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import type { FormEvent } from "react";
import { ChoiceField } from "../../components/ChoiceField";
import { DraftMark } from "../../components/DraftMark";
import { MotorMargins } from "../../components/MotorMargins";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { SettingField, type SettingValue } from "../../components/SettingField";
import { useLive } from "../../live/react";
import { capital } from "../../samples/words";
import { useAngles } from "../../service/angles";
import { useQueueCommand, useStartExperiment } from "../../service/commands";
import type { useDryRun } from "../../service/dryRun";
import { settingEntry } from "../../service/fieldHelp";
import { banksQuery } from "../../service/queries";
import { lastRefusal, RefusedFields } from "../../service/refusedFields";
import { tuningInWords } from "../../service/tuningWords";
import { isPlainRecord, useDraft } from "../../service/useDraft";
import { useMayCommand } from "../../service/useMayCommand";
import { useNoControl } from "../../service/useNoControl";
import type { ExperimentKind } from "../../wire/types";
import { whyNoStart } from "../operate/allowed";
import { NextMode } from "../operate/NextMode";
import page from "../Page.module.css";
import { DryRunProgress } from "./DryRunProgress";
import {
  bankChoices,
  hasChoice,
  isOfTheLoop,
  orderOf,
  type Shown,
  shownSettings,
  type Values,
} from "./order";
import { SegmentsEditor } from "./SegmentsEditor";
import { segmentsProblem } from "./segments";

const NO_CHANGES: Values = {};

interface ExperimentFormProps {
  readonly kind: ExperimentKind;
  onStarted(id: number): void;
  /** The page's: its result is shown beside whichever form is open by then. */
  readonly dryRun: ReturnType<typeof useDryRun>;
}

export function ExperimentForm({ kind, onStarted, dryRun }: ExperimentFormProps) {
  const draft = useDraft<Values>(`settings of ${kind.name}`, NO_CHANGES, isPlainRecord);
  const changed = draft.value;
  const state = useLive((live) => live.state);
  const { data: banks = [] } = useQuery(banksQuery);
  const start = useStartExperiment();
  const queue = useQueueCommand();
  const may = useMayCommand();
  const noControl = useNoControl();
  const shown = shownSettings(kind, state, changed, useAngles());
  const values = Object.fromEntries(shown.map(({ setting, value }) => [setting.name, value]));
  const asked = orderOf(kind, shown);
  const unknown = state === null ? "The tuning in force is not known yet." : null;
  const problem = unknown ?? asked.problem ?? segmentsProblem(values.segments);
  const order = problem === null ? asked.order : null;
  const beyond = kind.why_not === "" ? null : `${capital(kind.why_not)}.`;
  const reason = problem ?? beyond ?? whyNoStart(state, "experiment", noControl);
  const attempts = dryRun.variables?.name === kind.name ? [start, queue, dryRun] : [start, queue];
  const failure = problem === null ? lastRefusal(...attempts) : null;

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (reason !== null || order === null) return;
    start.mutate(order, { onSuccess: (started) => onStarted(started.id) });
  }

  const offered = shown.filter(({ setting }) => hasChoice(setting));
  const field = (one: Shown) => (
    <Field
      key={one.setting.name}
      shown={one}
      choices={one.setting.name === "bank" ? bankChoices(banks) : null}
      onChange={(value) => draft.set((before) => ({ ...before, [one.setting.name]: value }))}
    />
  );

  return (
    <RefusedFields error={failure} about={changed}>
      <form className={page.fields} aria-label={kind.title} onSubmit={submit}>
        <span className={page.dim}>{kind.description}</span>
        <DraftMark
          draft={draft}
          of={`settings of ${kind.title.toLowerCase()}`}
          words="Changed settings"
          back="The defaults and the tuning in force come back."
          onDiscard={draft.discard}
        />
        {offered.filter(({ setting }) => !isOfTheLoop(setting)).map(field)}
        <details>
          <summary>Settings of the loop: {tuningInWords(values, banks)}</summary>
          <div className={page.fields} style={{ paddingTop: 8 }}>
            {offered.filter(({ setting }) => isOfTheLoop(setting)).map(field)}
            {state !== null && typeof values.lam_motor === "number" && (
              <MotorMargins
                className={page.dim}
                lam_motor={values.lam_motor}
                bank={state.tuning.bank?.id ?? null}
              />
            )}
            <span className={page.dim}>After the experiment the tuning in force before it is back.</span>
          </div>
        </details>
        <div className={page.decide}>
          <div className={page.actions}>
            <OperatorsOnly>
              <Button
                type="submit"
                size="sm"
                aria-label={`Start ${kind.title.toLowerCase()}`}
                aria-disabled={reason !== null}
                data-disabled={reason !== null || undefined}
                loading={start.isPending}
              >
                Start
              </Button>
              <Button
                size="sm"
                variant="default"
                disabled={order === null || beyond !== null}
                loading={queue.isPending}
                onClick={() => order && queue.mutate({ do: "add", ...order })}
              >
                Add to queue
              </Button>
            </OperatorsOnly>
            <Button
              size="sm"
              variant="default"
              disabled={order === null}
              loading={dryRun.isPending}
              title="Play it on a simulator of its own, faster than real time; nothing moves"
              onClick={() => order && dryRun.mutate(order)}
            >
              Dry run
            </Button>
          </div>
          {dryRun.isPending && dryRun.variables?.name === kind.name && (
            <DryRunProgress onCancel={dryRun.cancel} />
          )}
          <Refusal error={failure} about={changed} text={may === false ? problem : reason}>
            {may !== false && problem === null && beyond === null && <NextMode need="start" />}
          </Refusal>
        </div>
      </form>
    </RefusedFields>
  );
}

interface FieldProps {
  readonly shown: Shown;
  /** Of a bank: what there is to choose from. */
  readonly choices: readonly { value: string; label: string }[] | null;
  onChange(value: SettingValue): void;
}

function Field({ shown: { setting, value, origin }, choices, onChange }: FieldProps) {
  const angles = useAngles();
  if (setting.name === "segments") return <SegmentsEditor json={String(value)} onChange={onChange} />;
  if (choices === null) {
    return <SettingField setting={setting} value={value} origin={origin} onChange={onChange} />;
  }
  const known = choices.some((choice) => choice.value === String(value));
  return (
    <ChoiceField
      name={setting.name}
      label="Models that the gains come from"
      description={origin}
      entry={settingEntry(setting, angles)}
      data={known ? [...choices] : [...choices, { value: String(value), label: `bank ${value}` }]}
      value={String(value)}
      onChange={(id) => onChange(Number(id))}
    />
  );
}
