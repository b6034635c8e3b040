/** Own experiments as texts: begun with one there is or a file, looked over, kept as a version, taken elsewhere. */

import { Button, FileButton, NativeSelect, Textarea } from "@mantine/core";
import { useQueryClient } from "@tanstack/react-query";
import { useEffect, useRef, useState } from "react";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { duration } from "../../samples/format";
import { counted } from "../../samples/words";
import { useCheckExperiment, useKeepExperiment } from "../../service/commands";
import { experimentTextQuery } from "../../service/queries";
import { lastRefusal } from "../../service/refusedFields";
import { RequestError } from "../../wire/client";
import type { ExperimentKind } from "../../wire/types";
import page from "../Page.module.css";

const SEQUENCE = "sequence";
const FILES = ".yaml,.yml,.json,application/yaml,application/json";

interface OwnExperimentsProps {
  readonly kinds: readonly ExperimentKind[];
  /** Told the name of what was kept: it can be run now. */
  onKept(name: string): void;
}

export function OwnExperiments({ kinds, onKept }: OwnExperimentsProps) {
  const [text, setText] = useState("");
  const [problem, setProblem] = useState<string | null>(null);
  const texts = useQueryClient();
  const check = useCheckExperiment();
  const keep = useKeepExperiment();
  const written = kinds.filter(({ name }) => name !== SEQUENCE);
  const named = /^name:\s*"?([A-Za-z]\w*)/m.exec(text)?.[1] ?? "experiment";

  function change(next: string): void {
    setText(next);
    setProblem(null);
    check.reset();
    keep.reset();
  }

  async function begin(name: string): Promise<void> {
    if (name === "") return;
    try {
      change(await texts.fetchQuery(experimentTextQuery(name)));
    } catch (error) {
      setProblem(error instanceof Error ? error.message : String(error));
    }
  }

  async function read(file: File | null): Promise<void> {
    if (file === null) return;
    change(await file.text());
  }

  const failure = lastRefusal(check, keep);
  const box = useRef<HTMLTextAreaElement>(null);
  useEffect(() => {
    const line = failure instanceof RequestError ? failure.problem?.line : null;
    if (box.current !== null && line != null) markLine(box.current, line);
  }, [failure]);
  const told = check.data && !keep.data ? inWords(check.data) : keep.data ? keptInWords(keep.data) : "";
  return (
    <Card title="Own experiments" aside={<span className={page.dim}>YAML or JSON, kept in versions</span>}>
      <div className={page.fields}>
        <div className={page.actions}>
          <NativeSelect
            aria-label="Begin with"
            size="sm"
            data={[
              { value: "", label: "Begin with …" },
              ...written.map(({ name, title }) => ({ value: name, label: title })),
            ]}
            value=""
            onChange={(event) => void begin(event.currentTarget.value)}
          />
          <FileButton accept={FILES} onChange={(file) => void read(file)}>
            {(props) => (
              <Button {...props} size="sm" variant="default">
                Open file
              </Button>
            )}
          </FileButton>
          <Button
            size="sm"
            variant="default"
            component="a"
            href={`data:application/yaml;charset=utf-8,${encodeURIComponent(text)}`}
            download={`${named}.yaml`}
            data-disabled={text === "" || undefined}
            aria-disabled={text === ""}
          >
            Save file
          </Button>
        </div>
        <Textarea
          aria-label="Text of the experiment"
          placeholder="Begin with an experiment there is, give it another name, and change it."
          value={text}
          onChange={(event) => change(event.currentTarget.value)}
          autosize
          minRows={6}
          maxRows={24}
          spellCheck={false}
          ref={box}
          wrap="off"
          styles={{ input: { fontFamily: "var(--mantine-font-family-monospace)", fontSize: 12 } }}
        />
        <div className={page.decide}>
          <div className={page.actions}>
            <Button
              size="sm"
              variant="default"
              disabled={text === ""}
              loading={check.isPending}
              onClick={() => check.mutate(text)}
            >
              Check
            </Button>
            <OperatorsOnly>
              <Button
                size="sm"
                disabled={text === ""}
                loading={keep.isPending}
                onClick={() =>
                  keep.mutate(text, { onSuccess: (kept) => onKept(`${kept.name}@${kept.version}`) })
                }
              >
                Keep
              </Button>
            </OperatorsOnly>
          </div>
          <Refusal error={failure} about={text} text={problem} hint={told} />
        </div>
      </div>
    </Card>
  );
}

/** Shows where a text is refused: its line is selected, and in sight. */
function markLine(box: HTMLTextAreaElement, line: number): void {
  const lines = box.value.split("\n");
  const start = lines.slice(0, line - 1).reduce((sum, one) => sum + one.length + 1, 0);
  box.focus();
  box.setSelectionRange(start, start + (lines[line - 1]?.length ?? 0));
  box.scrollTop = (box.scrollHeight / lines.length) * Math.max(0, line - 4);
}

interface Checked {
  readonly title: string;
  readonly duration_s: number;
  readonly segments: number;
  readonly changes_of_tuning: number;
  readonly criteria: number;
  readonly peak_voltage_V: number | null;
  readonly min_tension_N: number | null;
  readonly max_tension_N: number | null;
  readonly not_predicted: string;
}

function inWords(checked: Checked): string {
  const parts = [duration(checked.duration_s), counted(checked.segments, "piece")];
  if (checked.changes_of_tuning > 0)
    parts.push(`${counted(checked.changes_of_tuning, "change")} of the tuning`);
  parts.push(checked.criteria === 1 ? "1 criterion" : `${checked.criteria} criteria`);
  return `${checked.title} can be run: ${parts.join(", ")}. ${peaksInWords(checked)}`;
}

function peaksInWords(checked: Checked): string {
  const { peak_voltage_V: volts, min_tension_N: least, max_tension_N: most } = checked;
  if (volts === null || least === null || most === null) {
    return `Its peaks are not known: ${checked.not_predicted || "a dry run did not complete"}.`;
  }
  const [u, low, high] = [volts, least, most].map((figure) => figure.toPrecision(3));
  return `On the simulator: ${u} V at most, tensions ${low} to ${high} N.`;
}

function keptInWords(kept: { readonly name: string; readonly version: number }): string {
  return `Kept as ${kept.name}@${kept.version}: it can be chosen as a new experiment now.`;
}
