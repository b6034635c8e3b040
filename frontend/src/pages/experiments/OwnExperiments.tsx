/** Own experiments, as a sequence or as a text: begun with one there is or a file, looked over, kept, taken elsewhere. */

import { Button, FileButton, NativeSelect, SegmentedControl, Textarea } from "@mantine/core";
import { useQueryClient } from "@tanstack/react-query";
import { useEffect, useEffectEvent, useRef, useState } from "react";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { useCheckExperiment, useKeepExperiment } from "../../service/commands";
import { experimentAsRunQuery, experimentTextQuery } from "../../service/ownExperiments";
import { lastRefusal, RefusedFields } from "../../service/refusedFields";
import { RequestError } from "../../wire/client";
import type { ExperimentKind } from "../../wire/types";
import page from "../Page.module.css";
import { CriteriaEditor } from "./CriteriaEditor";
import { asDocument, type Document, documentIn, EMPTY, writeDocument } from "./document";
import { inWords, Preview } from "./Preview";
import { SequenceEditor } from "./SequenceEditor";
import { useComposedPreview } from "./useComposedPreview";
import { Versions } from "./Versions";

const SEQUENCE = "sequence";
const NEW = "an empty sequence";
const FILES = ".yaml,.yml,.json,application/yaml,application/json";

interface OwnExperimentsProps {
  readonly kinds: readonly ExperimentKind[];
  /** The run whose references are to be made an experiment of. */
  readonly asRun: number | null;
  /** Told the name of what was kept: it can be run now. */
  onKept(name: string): void;
}

export function OwnExperiments({ kinds, asRun, onKept }: OwnExperimentsProps) {
  const [{ text, document }, set] = useState<Written>({ text: "", document: null });
  const [shown, show] = useState<"sequence" | "text">("sequence");
  const [problem, setProblem] = useState<string | null>(null);
  const texts = useQueryClient();
  const check = useCheckExperiment();
  const keep = useKeepExperiment();
  const written = kinds.filter(({ name }) => name !== SEQUENCE);
  const named = /^\s*"?name"?:\s*"?([A-Za-z]\w*)/m.exec(text)?.[1] ?? "experiment";

  const preview = useComposedPreview(shown === "sequence" ? text : "");
  const composed = document ?? (preview.current ? asDocument(preview.checked?.document) : null);

  function change(next: string, read: Document | null = documentIn(next)): void {
    set({ text: next, document: read });
    setProblem(null);
    check.reset();
    keep.reset();
  }

  async function begin(name: string): Promise<void> {
    if (name === "") return;
    if (name === NEW) change(writeDocument(EMPTY), EMPTY);
    else await open(() => texts.fetchQuery(experimentTextQuery(name)));
  }

  async function open(fetch: () => Promise<{ text: string; document: unknown }>): Promise<void> {
    try {
      const begun = await fetch();
      change(begun.text, asDocument(begun.document));
    } catch (error) {
      setProblem(error instanceof Error ? error.message : String(error));
    }
  }

  const card = useRef<HTMLDivElement>(null);
  const openRun = useEffectEvent((run: number) => {
    card.current?.scrollIntoView({ block: "start" });
    void open(() => texts.fetchQuery(experimentAsRunQuery(run)));
  });
  useEffect(() => {
    if (asRun !== null) openRun(asRun);
  }, [asRun]);

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
    <Card
      title="Own experiments"
      aside={
        <SegmentedControl
          size="xs"
          p={3}
          aria-label="Shown as"
          data={[
            { value: "sequence", label: "Sequence" },
            { value: "text", label: "Text" },
          ]}
          value={shown}
          onChange={(value) => show(value as typeof shown)}
        />
      }
    >
      <div className={page.fields} ref={card}>
        <div className={page.actions}>
          <NativeSelect
            aria-label="Begin with"
            size="sm"
            data={[
              { value: "", label: "Begin with …" },
              { value: NEW, label: "An empty sequence" },
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
        {shown === "sequence" && text === "" && (
          <p className={page.empty}>Begin with an experiment there is, a run, or an empty sequence.</p>
        )}
        {shown === "sequence" && text !== "" && composed === null && (
          <p className={page.empty}>
            {preview.error === null ? "Its text is being read …" : "It is no sequence yet: mend its text."}
          </p>
        )}
        {shown === "sequence" && composed !== null && (
          <RefusedFields error={keep.error} foreseen={preview.error} about={text}>
            <SequenceEditor
              document={composed}
              played={preview.current ? (preview.checked?.parts ?? []) : []}
              onChange={(next) => change(writeDocument(next), next)}
            />
            <CriteriaEditor
              criteria={composed.criteria ?? []}
              metrics={preview.checked?.dry_run?.metrics ?? []}
              onChange={(criteria) => {
                const next = { ...composed, criteria };
                change(writeDocument(next), next);
              }}
            />
          </RefusedFields>
        )}
        {shown === "sequence" && text !== "" && (
          <Preview
            checked={preview.checked}
            current={preview.current}
            problem={preview.error?.message ?? null}
          />
        )}
        {shown === "text" && (
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
        )}
        <div className={page.decide}>
          <div className={page.actions}>
            {shown === "text" && (
              <Button
                size="sm"
                variant="default"
                disabled={text === ""}
                loading={check.isPending}
                onClick={() => check.mutate(text)}
              >
                Check
              </Button>
            )}
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
          <Refusal
            error={failure ?? (shown === "sequence" ? preview.error : null)}
            about={text}
            text={problem}
            hint={told}
          />
        </div>
        <Versions name={named} document={composed} onOpen={(name) => void begin(name)} />
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

interface Written {
  readonly text: string;
  /** Null for a text that only the service can read, until it has. */
  readonly document: Document | null;
}

function keptInWords(kept: { readonly name: string; readonly version: number }): string {
  return `Kept as ${kept.name}@${kept.version}: it can be chosen as a new experiment now.`;
}
