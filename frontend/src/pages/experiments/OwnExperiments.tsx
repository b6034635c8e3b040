/** Own experiments, as a sequence or as a text: begun with one there is or a file, looked over, kept, taken elsewhere. */

import { Button, FileButton, NativeSelect, SegmentedControl, Textarea } from "@mantine/core";
import { useQueryClient } from "@tanstack/react-query";
import { useEffect, useEffectEvent, useMemo, useRef, useState } from "react";
import { Card } from "../../components/Card";
import { DraftMark } from "../../components/DraftMark";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { useReplaceDraft } from "../../components/ReplaceDraft";
import { useCheckExperiment, useKeepExperiment } from "../../service/commands";
import {
  experimentAsRunQuery,
  experimentTextQuery,
  experimentVersionsQuery,
} from "../../service/ownExperiments";
import { lastRefusal, RefusedFields } from "../../service/refusedFields";
import { isText, useDraft } from "../../service/useDraft";
import { RequestError } from "../../wire/client";
import type { ExperimentKind } from "../../wire/types";
import page from "../Page.module.css";
import { CriteriaEditor } from "./CriteriaEditor";
import { asDocument, documentIn, SAMPLE, writeDocument } from "./document";
import { LeftOut } from "./LeftOut";
import { isOpened, NOTHING_OPENED, type Opened, savedMeanwhile } from "./opened";
import { inWords, Preview } from "./Preview";
import { SequenceEditor } from "./SequenceEditor";
import { useComposedPreview } from "./useComposedPreview";
import { Versions } from "./Versions";

const SEQUENCE = "sequence";
const NEW = "sample sequence";
const FILES = ".yaml,.yml,.json,application/yaml,application/json";

interface OwnExperimentsProps {
  readonly kinds: readonly ExperimentKind[];
  /** The run whose references are to be made an experiment of. */
  readonly asRun: number | null;
  /** The run of the address is being opened: a reload opens the draft, not the run again. */
  onRunOpened(): void;
  /** LocalizedText the name of what was kept: it can be run now. */
  onKept(name: string): void;
}

export function OwnExperiments({ kinds, asRun, onRunOpened, onKept }: OwnExperimentsProps) {
  const opened = useDraft("opened experiment", NOTHING_OPENED, isOpened);
  const draft = useDraft("experiment", opened.value.text, isText);
  const shownAs = useDraft<"sequence" | "text">("experiment shown as", "sequence", isShownAs);
  const [shown, text] = [shownAs.value, draft.value];
  const [guard, question] = useReplaceDraft(draft.since !== null);
  const [meanwhile, setMeanwhile] = useState<string | null>(null);
  const [problem, setProblem] = useState<string | null>(null);
  const texts = useQueryClient();
  const check = useCheckExperiment();
  const keep = useKeepExperiment();
  const written = kinds.filter(({ name }) => name !== SEQUENCE);
  const named = /^\s*"?name"?:\s*"?([A-Za-z]\w*)/m.exec(text)?.[1] ?? "experiment";

  const preview = useComposedPreview(shown === "sequence" ? text : "");
  const read = text === opened.value.text ? asDocument(opened.value.document) : null;
  const document = useMemo(() => read ?? documentIn(text), [read, text]);
  const composed = document ?? (preview.current ? asDocument(preview.checked?.document) : null);

  function forget(): void {
    setProblem(null);
    setMeanwhile(null);
    check.reset();
    keep.reset();
  }

  function change(next: string): void {
    draft.set(next);
    forget();
  }

  function show(next: Opened): void {
    opened.set(next);
    draft.discard();
    forget();
  }

  function begin(name: string): void {
    if (name === NEW) guard(() => show({ ...NOTHING_OPENED, text: writeDocument(SAMPLE) }));
    else if (name !== "") guard(() => void openNamed(name));
  }

  async function openNamed(name: string): Promise<void> {
    const base = name.split("@")[0] ?? name;
    await open(async () => {
      const [begun, versions] = await Promise.all([
        texts.fetchQuery(experimentTextQuery(name)),
        texts.fetchQuery({ ...experimentVersionsQuery(base), staleTime: 0 }),
      ]);
      const newest = versions[0]?.version ?? 0;
      return {
        text: begun.text,
        document: begun.document,
        name: newest > 0 ? base : "",
        newest,
        leftOut: [],
      };
    });
  }

  async function open(fetch: () => Promise<Opened>): Promise<void> {
    try {
      show(await fetch());
    } catch (error) {
      setProblem(error instanceof Error ? error.message : String(error));
    }
  }

  const card = useRef<HTMLDivElement>(null);
  const openRun = useEffectEvent((run: number) => {
    card.current?.scrollIntoView({ block: "start" });
    onRunOpened();
    guard(
      () =>
        void open(async () => {
          const { left_out, ...begun } = await texts.fetchQuery(experimentAsRunQuery(run));
          return { ...NOTHING_OPENED, ...begun, leftOut: left_out };
        }),
    );
  });
  useEffect(() => {
    if (asRun !== null) openRun(asRun);
  }, [asRun]);

  async function openFile(file: File | null): Promise<void> {
    if (file === null) return;
    const next = await file.text();
    guard(() => change(next));
  }

  async function keepIt(isAsked: boolean): Promise<void> {
    const before = isAsked ? [] : await versionsOf(named);
    const question = savedMeanwhile(opened.value, named, before);
    setMeanwhile(question);
    if (question !== null) return;
    keep.mutate(text, {
      onSuccess: (kept) => {
        opened.set({ ...NOTHING_OPENED, text, document, name: kept.name, newest: kept.version });
        draft.discard();
        onKept(`${kept.name}@${kept.version}`);
      },
    });
  }

  /** None where they cannot be read: then the service refuses the text as well, and says why. */
  function versionsOf(name: string) {
    return texts.fetchQuery({ ...experimentVersionsQuery(name), staleTime: 0 }).catch(() => []);
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
          onChange={(value) => shownAs.set(value as typeof shown)}
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
              { value: NEW, label: "Sample sequence: three parts, one criterion" },
              ...written.map(({ name, title }) => ({ value: name, label: title })),
            ]}
            value=""
            onChange={(event) => begin(event.currentTarget.value)}
          />
          <FileButton accept={FILES} onChange={(file) => void openFile(file)}>
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
        {question}
        <DraftMark
          draft={draft}
          of="experiment"
          back={
            opened.value.name === ""
              ? "The text it began with comes back."
              : `${opened.value.name}@${opened.value.newest} comes back.`
          }
          onDiscard={() => {
            draft.discard();
            forget();
          }}
        />
        <LeftOut of={opened.value.leftOut} />
        {shown === "sequence" && text === "" && (
          <p className={page.empty}>Begin with an experiment there is, a run, or the sample sequence.</p>
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
              onChange={(next) => change(writeDocument(next))}
            />
            <CriteriaEditor
              criteria={composed.criteria ?? []}
              metrics={preview.checked?.dry_run?.metrics ?? []}
              onChange={(criteria) => change(writeDocument({ ...composed, criteria }))}
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
                onClick={() => void keepIt(meanwhile !== null)}
              >
                {meanwhile === null ? "Keep" : "Keep anyway"}
              </Button>
            </OperatorsOnly>
          </div>
          <Refusal
            error={failure ?? (shown === "sequence" ? preview.error : null)}
            about={text}
            text={problem ?? meanwhile}
            hint={told}
          />
        </div>
        <Versions name={named} document={composed} onOpen={begin} />
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

function isShownAs(value: unknown): value is "sequence" | "text" {
  return value === "sequence" || value === "text";
}

function keptInWords(kept: { readonly name: string; readonly version: number }): string {
  return `Kept as ${kept.name}@${kept.version}: it can be chosen as a new experiment now.`;
}
