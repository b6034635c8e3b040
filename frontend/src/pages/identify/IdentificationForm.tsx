/** Set-up of an identification: what to identify, its settings, and what to expect before it starts. */

import { Button, SegmentedControl } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { type FormEvent, useEffect, useMemo } from "react";
import { Card } from "../../components/Card";
import { ChoiceField } from "../../components/ChoiceField";
import { DraftMark } from "../../components/DraftMark";
import { NumberField } from "../../components/NumberField";
import { Refusal } from "../../components/Refusal";
import { TextField } from "../../components/TextField";
import { useLive, useLiveStore } from "../../live/react";
import { fixed } from "../../samples/format";
import { type Angles, labelWith, rangeText } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { useStartIdentification } from "../../service/commands";
import { fieldEntry, settingEntry } from "../../service/fieldHelp";
import { banksQuery, identificationKindsQuery, predictionQuery } from "../../service/queries";
import { RefusedFields } from "../../service/refusedFields";
import { tuningInWords } from "../../service/tuningWords";
import { isPlainRecord, useDraft } from "../../service/useDraft";
import { useNoControl } from "../../service/useNoControl";
import { DEGREES } from "../../theme/signals";
import type { IdentificationKind, Setting } from "../../wire/types";
import { tuningOf } from "../experiments/order";
import { whyNoStart } from "../operate/allowed";
import { NextMode } from "../operate/NextMode";
import page from "../Page.module.css";
import styles from "./Identify.module.css";
import { type Kind, labelOf, originOf, requestOf, type Values, valuesOf } from "./order";
import type { LocalizedText } from "./PredictionView";
import { SpringTableForm } from "./SpringTableForm";

const NOMINAL_TENSIONS_N = [10, 20, 30, 40];

/** What a person changed of a kind's settings. */
interface Changes {
  readonly changed: Values;
  readonly tensions: string;
}

const NO_CHANGES: Changes = { changed: {}, tensions: "" };

interface FormProps {
  onStarted(run: number): void;
  onTable(id: number): void;
  /** What the run in the form would do. */
  onForecast(told: LocalizedText): void;
}

export function IdentificationForm({ onStarted, onTable, onForecast }: FormProps) {
  const kinds = useQuery(identificationKindsQuery);
  const { value: kind, set: setKind } = useDraft<Kind>("kind of identification", "actuator", isKind);
  const chosen = kinds.data?.find((entry) => entry.kind === kind);
  return (
    <Card title="New identification">
      <div className={page.fields}>
        <SegmentedControl
          aria-label="What to identify"
          fullWidth
          value={kind}
          data={(kinds.data ?? []).map((entry) => ({ value: entry.kind, label: entry.title }))}
          onChange={(value) => setKind(value as Kind)}
        />
        <span className={page.dim}>{chosen?.description ?? kinds.error?.message ?? "Loading …"}</span>
        {chosen && <KindForm key={kind} kind={chosen} onStarted={onStarted} onForecast={onForecast} />}
        {kind === "spring" && <SpringTableForm onTable={onTable} />}
      </div>
    </Card>
  );
}

interface KindFormProps extends Pick<FormProps, "onStarted" | "onForecast"> {
  readonly kind: IdentificationKind;
}

function KindForm({ kind, onStarted, onForecast }: KindFormProps) {
  const angles = useAngles();
  const draft = useDraft(`identification of ${kind.kind}`, NO_CHANGES, isChanges);
  const { changed, tensions } = draft.value;
  const state = useLive((live) => live.state);
  const { data: banks = [] } = useQuery(banksQuery);
  const tuning = tuningOf(state);
  const start = useStartIdentification();
  const noControl = useNoControl();
  const values = useMemo(() => valuesOf(kind, changed, angles), [kind, changed, angles]);
  const asked = useMemo(
    () => requestOf(kind, values, kind.kind === "actuator" ? tensions : ""),
    [kind, values, tensions],
  );
  const [request] = useDebouncedValue(asked.request, 300);
  const [from] = useDebouncedValue(useWhereabouts(), 300);
  const prediction = useQuery(predictionQuery(request, from));
  const leaves =
    prediction.data?.within_range === false ? "The run would leave the range, see the forecast." : null;
  const reason = asked.problem ?? whyNoStart(state, "identify", noControl) ?? leaves;

  const problem = asked.problem ?? prediction.error?.message;
  useEffect(
    () => onForecast({ prediction: prediction.data, problem }),
    [onForecast, prediction.data, problem],
  );

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (reason === null && asked.request !== null) {
      start.mutate(asked.request, { onSuccess: (started) => onStarted(started.id) });
    }
  }

  function set(name: string, value: number | string): void {
    draft.set((before) => ({ ...before, changed: { ...before.changed, [name]: value } }));
  }

  return (
    <RefusedFields error={start.error} foreseen={prediction.error} about={[changed, tensions]}>
      <form className={page.fields} aria-label="New identification" onSubmit={submit}>
        <DraftMark
          draft={draft}
          of="identification"
          words="Changed settings"
          back="The defaults come back."
          onDiscard={draft.discard}
        />
        {kind.kind === "actuator" && (
          <TensionFields
            tension_N={values.tension_N ?? ""}
            tensions={tensions}
            problem={asked.place === "tensions_N" ? asked.problem : null}
            onTension={(value) => set("tension_N", value)}
            onTensions={(text) => draft.set((before) => ({ ...before, tensions: text }))}
          />
        )}
        <div className={styles.grid}>
          {kind.settings
            .filter((setting) => setting.name !== "tension_N")
            .map((setting) =>
              setting.choices ? (
                <ChoiceField
                  key={setting.name}
                  name={setting.name}
                  label={labelOf(setting)}
                  description={describe(setting, originOf(setting, changed, angles), angles)}
                  entry={settingEntry(setting, angles)}
                  data={[...setting.choices]}
                  value={String(values[setting.name] ?? "")}
                  onChange={(value) => set(setting.name, value)}
                />
              ) : (
                <NumberField
                  key={setting.name}
                  name={setting.name}
                  label={labelWith(labelOf(setting), setting.unit, angles)}
                  description={describe(setting, originOf(setting, changed, angles), angles)}
                  entry={settingEntry(setting, angles)}
                  unit={setting.unit}
                  value={values[setting.name] ?? ""}
                  onChange={(value) => set(setting.name, value)}
                />
              ),
            )}
        </div>
        {state !== null && (
          <span className={page.dim}>Runs with what is in force: {tuningInWords(tuning, banks)}.</span>
        )}
        <div className={page.decide}>
          <Button
            type="submit"
            size="sm"
            aria-disabled={reason !== null}
            data-disabled={reason !== null || undefined}
            loading={start.isPending}
          >
            Start identification
          </Button>
          <Refusal error={start.error} about={[changed, tensions]} text={reason}>
            {asked.problem === null && <NextMode need="start" />}
          </Refusal>
        </div>
      </form>
    </RefusedFields>
  );
}

function isKind(value: unknown): value is Kind {
  return value === "actuator" || value === "motor" || value === "spring";
}

function isChanges(value: unknown): value is Changes {
  const { changed, tensions } = (value ?? {}) as Partial<Changes>;
  return isPlainRecord(changed) && typeof tensions === "string";
}

/** What a setting means, its range and where its value comes from, below its box. */
function describe({ meaning, minimum, maximum, unit }: Setting, origin: string, angles: Angles): string {
  const range = minimum == null || maximum == null ? "" : rangeText(minimum, maximum, unit, angles);
  return [meaning, range.replaceAll(" ", "\u00a0"), origin].filter((part) => part !== "").join("; ");
}

/** Where the joint is, to a degree, as far as a forecast depends on it: what is told holds from there. */
function useWhereabouts(): string {
  const store = useLiveStore();
  return useLive(({ state }) => {
    // while a run is under way the next one starts from where that one ends
    if (state === null || state.task !== null) return "";
    const { mode, pretension_done, tuning } = state;
    return [mode, pretension_done, tuning.lam_motor, fixed(store.window.newest("q") * DEGREES, 0)].join();
  });
}

interface TensionProps {
  readonly tension_N: number | string;
  readonly tensions: string;
  /** Why the text lists no tensions. */
  readonly problem: string | null;
  onTension(value: number | string): void;
  onTensions(text: string): void;
}

/** One tension, or several, one run after the other. */
function TensionFields({ tension_N, tensions, problem, onTension, onTensions }: TensionProps) {
  const angles = useAngles();
  const inTurn = tensions.trim() !== "";
  return (
    <>
      <div className={styles.tension}>
        <NumberField
          name="tension_N"
          label="Tension [N]"
          entry={fieldEntry("identification.tension_N", angles)}
          value={tension_N}
          disabled={inTurn}
          onChange={onTension}
        />
        <Button.Group>
          {NOMINAL_TENSIONS_N.map((tension) => (
            <Button
              key={tension}
              variant={!inTurn && tension_N === tension ? "light" : "default"}
              aria-label={`Tension ${tension} N`}
              aria-pressed={!inTurn && tension_N === tension}
              onClick={() => {
                onTensions("");
                onTension(tension);
              }}
              px={10}
              h={30}
            >
              {tension}
            </Button>
          ))}
        </Button.Group>
      </div>
      <div className={styles.tension}>
        <TextField
          name="tensions_N"
          label="Several tensions in turn [N]"
          entry={fieldEntry("identification.tensions_N", angles)}
          placeholder="none: the one above"
          value={tensions}
          problem={problem}
          onChange={onTensions}
        />
        <Button
          variant={inTurn ? "light" : "default"}
          aria-pressed={inTurn}
          h={30}
          onClick={() => onTensions(inTurn ? "" : NOMINAL_TENSIONS_N.join(", "))}
        >
          All four
        </Button>
      </div>
    </>
  );
}
