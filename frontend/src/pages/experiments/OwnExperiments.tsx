import { Button, FileButton, NativeSelect, SegmentedControl, Table, Textarea } from "@mantine/core";
import { useQueries, useQuery, useQueryClient } from "@tanstack/react-query";
import { useEffect, useEffectEvent, useMemo, useRef, useState } from "react";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { DraftMark, useReplaceDraft } from "../../components/DraftMark";
import { Refusal } from "../../components/Refusal";
import { dateTime } from "../../samples/format";
import type { AngleUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import {
  experimentAsRunQuery,
  experimentTextQuery,
  experimentVersionsQuery,
  useCheckExperiment,
  useSaveExperiment,
} from "../../service/api/experiments";
import { useAngleUnit } from "../../service/api/preferences";
import { isText, useDraft } from "../../service/forms/drafts";
import { lastRefusal, RefusedFields } from "../../service/forms/refusals";
import { RequestError } from "../../wire/client";
import type { ExperimentKind, OwnExperiment } from "../../wire/types";
import pageStyles from "../Page.module.css";
import { CriteriaEditor } from "./CriteriaEditor";
import { LeftOut } from "./DryRun";
import {
  asDocument,
  type Bound,
  type Document,
  documentIn,
  innerOf,
  type Part,
  SAMPLE,
  writeDocument,
} from "./document";
import { describePart } from "./PartList";
import { describeCheck, Preview, useComposedPreview } from "./Preview";
import { SequenceEditor } from "./SequenceEditor";
import { TEXTS } from "./texts";

const MOST_DIFFERENCES = 6;

/** Describes the differences between two experiments: added, removed and changed parts; empty without any. */
export function differences(from: Document, to: Document, angles: AngleUnit): string[] {
  const words = [
    ...(from.title === to.title ? [] : [fillText(TEXTS.titleChanged, { from: from.title, to: to.title })]),
    ...ofLists(lines(from, angles), lines(to, angles)),
    ...ofLists(from.criteria?.map(boundLine) ?? [], to.criteria?.map(boundLine) ?? []),
    ...Object.keys({ ...from, ...to })
      .filter((name) => !["name", "title", "phases", "criteria"].includes(name))
      .filter((name) => JSON.stringify(from[name]) !== JSON.stringify(to[name]))
      .map((name) => fillText(TEXTS.fieldChanged, { field: name })),
  ];
  return words.length <= MOST_DIFFERENCES
    ? words
    : [
        ...words.slice(0, MOST_DIFFERENCES),
        fillText(TEXTS.moreDifferences, { count: words.length - MOST_DIFFERENCES }),
      ];
}

/** Returns one line for each part, indented by its loops. */
function lines(document: Document, angles: AngleUnit): string[] {
  const of = (parts: readonly Part[], indent: string): string[] =>
    parts.flatMap((part) => [
      indent + describePart(part, angles),
      ...innerOf(part).flatMap(([, inner]) => of(inner, indent + TEXTS.inLoop)),
    ]);
  return document.phases.flatMap((phase) => [
    fillText(TEXTS.phaseLine, { title: phase.title }),
    ...of(phase.parts, ""),
  ]);
}

function boundLine({ figure, below, above }: Bound): string {
  return below === undefined
    ? fillText(TEXTS.boundAbove, { metric: figure, bound: String(above) })
    : fillText(TEXTS.boundBelow, { metric: figure, bound: below });
}

/** Describes removed and added lines of two lists, by their longest common subsequence. */
function ofLists(from: readonly string[], to: readonly string[]): string[] {
  const common: number[][] = Array.from({ length: from.length + 1 }, () => new Array(to.length + 1).fill(0));
  const held = (i: number, j: number) => common[i]?.[j] ?? 0;
  for (let i = from.length - 1; i >= 0; i -= 1) {
    for (let j = to.length - 1; j >= 0; j -= 1) {
      (common[i] as number[])[j] =
        from[i] === to[j] ? held(i + 1, j + 1) + 1 : Math.max(held(i + 1, j), held(i, j + 1));
    }
  }
  const words: string[] = [];
  let [i, j] = [0, 0];
  while (i < from.length || j < to.length) {
    if (i < from.length && j < to.length && from[i] === to[j]) [i, j] = [i + 1, j + 1];
    else if (j >= to.length || (i < from.length && held(i + 1, j) >= held(i, j + 1)))
      words.push(fillText(TEXTS.removed, { line: String(from[i++]) }));
    else words.push(fillText(TEXTS.added, { line: String(to[j++]) }));
  }
  return words;
}

/** Experiment that was opened in the editor. */
interface Opened {
  readonly text: string;
  /** Content of the text as plain data, parsed by the service; null if the text is JSON or empty. */
  readonly document: unknown;
  /** Name of an own experiment; otherwise empty. */
  readonly name: string;
  /** Newest version of this name at that time. */
  readonly newest: number;
  /** Parts of a run that the experiment created from it does not repeat. */
  readonly leftOut: readonly string[];
}

export const NOTHING_OPENED: Opened = { text: "", document: null, name: "", newest: 0, leftOut: [] };

/** Whether stored data has the format of this version of the page. */
export function isOpened(value: unknown): value is Opened {
  if (typeof value !== "object" || value === null) return false;
  const { text, document, name, newest, leftOut } = value as Record<string, unknown>;
  return (
    typeof text === "string" &&
    (document === null || asDocument(document) !== null) &&
    typeof name === "string" &&
    typeof newest === "number" &&
    Array.isArray(leftOut)
  );
}

/** Returns the question before a text is saved; null if nobody has saved another version since it was opened. */
export function savedMeanwhile(
  opened: Opened,
  name: string,
  versions: readonly OwnExperiment[],
): string | null {
  const newest = versions[0];
  if (newest === undefined) return null;
  const known = opened.name === name ? opened.newest : 0;
  if (newest.version <= known) return null;
  const { who: person, version } = newest;
  const problem = fillText(known === 0 ? TEXTS.nameTaken : TEXTS.savedMeanwhile, { name, person, version });
  return fillText(TEXTS.saveAdds, { problem, next: version + 1, version });
}

interface VersionsProps {
  readonly name: string;
  readonly document: Document | null;
  /** Opens a version; saving it creates the newest version. */
  onOpen(name: string): void;
}

const MOST_VERSIONS = 10;

function Versions({ name, document, onOpen }: VersionsProps) {
  const angles = useAngleUnit();
  const { data = [] } = useQuery(experimentVersionsQuery(name));
  const listed = data.slice(0, MOST_VERSIONS);
  const texts = useQueries({
    queries: listed.map(({ version }) => experimentTextQuery(`${name}@${version}`)),
  });
  if (listed.length === 0) return null;
  return (
    <details>
      <summary>{fillText(TEXTS.versionsCount, { name, count: data.length })}</summary>
      <Table aria-label={fillText(TEXTS.versions, { name })} verticalSpacing={4}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{TEXTS.version}</Table.Th>
            <Table.Th>{TEXTS.savedBy}</Table.Th>
            <Table.Th>{TEXTS.differences}</Table.Th>
            <Table.Th aria-label={TEXTS.open} />
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {listed.map(({ version, who, created }, index) => {
            const then = asDocument(texts[index]?.data?.document);
            return (
              <Table.Tr key={version}>
                <Table.Td>{version}</Table.Td>
                <Table.Td>
                  {who}, {dateTime(created)}
                </Table.Td>
                <Table.Td>
                  {then === null || document === null ? (
                    <span className={pageStyles.dim}>{TEXTS.notCompared}</span>
                  ) : (
                    differences(then, document, angles).join("; ") || TEXTS.same
                  )}
                </Table.Td>
                <Table.Td>
                  <Button
                    size="compact-xs"
                    variant="default"
                    aria-label={fillText(TEXTS.openVersion, { version })}
                    onClick={() => onOpen(`${name}@${version}`)}
                  >
                    {TEXTS.open}
                  </Button>
                </Table.Td>
              </Table.Tr>
            );
          })}
        </Table.Tbody>
      </Table>
    </details>
  );
}

const NEW = "sample sequence";
const FILES = ".yaml,.yml,.json,application/yaml,application/json";

interface OwnExperimentsProps {
  readonly kinds: readonly ExperimentKind[];
  /** Run from whose references to create an experiment. */
  readonly asRun: number | null;
  /** Called when the run of the address opens; a reload then opens the draft instead of the run. */
  onRunOpened(): void;
  /** Receives the name of the saved experiment, which can be run now. */
  onSaved(name: string): void;
}

/** Editor of own experiments, as a sequence or a text: opens, checks, saves and exports them. */
export function OwnExperiments({ kinds, asRun, onRunOpened, onSaved }: OwnExperimentsProps) {
  const opened = useDraft("opened experiment", NOTHING_OPENED, isOpened);
  const draft = useDraft("experiment", opened.value.text, isText);
  const shownAs = useDraft<"sequence" | "text">("experiment shown as", "sequence", isShownAs);
  const [shown, text] = [shownAs.value, draft.value];
  const [guard, question] = useReplaceDraft(draft.since !== null);
  const [meanwhile, setMeanwhile] = useState<string | null>(null);
  const [problem, setProblem] = useState<string | null>(null);
  const texts = useQueryClient();
  const check = useCheckExperiment();
  const store = useSaveExperiment();
  const named = /^\s*"?name"?:\s*"?([A-Za-z]\w*)/m.exec(text)?.[1] ?? "experiment";

  const preview = useComposedPreview(shown === "sequence" ? text : "");
  const read = text === opened.value.text ? asDocument(opened.value.document) : null;
  const document = useMemo(() => read ?? documentIn(text), [read, text]);
  const composed = document ?? (preview.current ? asDocument(preview.checked?.document) : null);

  function forget(): void {
    setProblem(null);
    setMeanwhile(null);
    check.reset();
    store.reset();
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

  async function save(isAsked: boolean): Promise<void> {
    const before = isAsked ? [] : await versionsOf(named);
    const question = savedMeanwhile(opened.value, named, before);
    setMeanwhile(question);
    if (question !== null) return;
    store.mutate(text, {
      onSuccess: (stored) => {
        opened.set({ ...NOTHING_OPENED, text, document, name: stored.name, newest: stored.version });
        draft.discard();
        onSaved(`${stored.name}@${stored.version}`);
      },
    });
  }

  /** Returns no versions if the request fails: the service then also refuses the text, and states the reason. */
  function versionsOf(name: string) {
    return texts.fetchQuery({ ...experimentVersionsQuery(name), staleTime: 0 }).catch(() => []);
  }

  const failure = lastRefusal(check, store);
  const box = useRef<HTMLTextAreaElement>(null);
  useEffect(() => {
    const line = failure instanceof RequestError ? failure.problem?.line : null;
    if (box.current !== null && line != null) markLine(box.current, line);
  }, [failure]);
  const outcome =
    check.data && !store.data ? describeCheck(check.data) : store.data ? describeSaved(store.data) : "";
  return (
    <Card
      title={TEXTS.ownExperiments}
      aside={
        <SegmentedControl
          size="xs"
          p={3}
          aria-label={TEXTS.shownAs}
          data={[
            { value: "sequence", label: TEXTS.asSequence },
            { value: "text", label: TEXTS.asText },
          ]}
          value={shown}
          onChange={(value) => shownAs.set(value as typeof shown)}
        />
      }
    >
      <div className={pageStyles.fields} ref={card}>
        <div className={pageStyles.actions}>
          <NativeSelect
            aria-label={TEXTS.startFrom}
            size="sm"
            data={[
              { value: "", label: TEXTS.chooseStart },
              { value: NEW, label: TEXTS.sampleSequence },
              ...kinds.map(({ name, title }) => ({ value: name, label: title })),
            ]}
            value=""
            onChange={(event) => begin(event.currentTarget.value)}
          />
          <FileButton accept={FILES} onChange={(file) => void openFile(file)}>
            {(props) => (
              <Button {...props} size="sm" variant="default">
                {TEXTS.openFile}
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
            {TEXTS.saveFile}
          </Button>
        </div>
        {question}
        <DraftMark
          draft={draft}
          of={TEXTS.draftOf}
          back={
            opened.value.name === ""
              ? TEXTS.restoresText
              : fillText(TEXTS.restoresVersion, {
                  name: opened.value.name,
                  version: opened.value.newest,
                })
          }
          onDiscard={() => {
            draft.discard();
            forget();
          }}
        />
        <LeftOut of={opened.value.leftOut} />
        {shown === "sequence" && text === "" && <p className={pageStyles.empty}>{TEXTS.nothingOpened}</p>}
        {shown === "sequence" && text !== "" && composed === null && (
          <p className={pageStyles.empty}>
            {preview.error === null ? TEXTS.readingText : TEXTS.notASequence}
          </p>
        )}
        {shown === "sequence" && composed !== null && (
          <RefusedFields error={store.error} foreseen={preview.error} about={text}>
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
            aria-label={TEXTS.text}
            placeholder={TEXTS.textHint}
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
        <div className={pageStyles.decide}>
          <div className={pageStyles.actions}>
            {shown === "text" && (
              <Button
                size="sm"
                variant="default"
                disabled={text === ""}
                loading={check.isPending}
                onClick={() => check.mutate(text)}
              >
                {TEXTS.check}
              </Button>
            )}
            <OperatorsOnly>
              <Button
                size="sm"
                disabled={text === ""}
                loading={store.isPending}
                onClick={() => void save(meanwhile !== null)}
              >
                {meanwhile === null ? TEXTS.save : TEXTS.saveAnyway}
              </Button>
            </OperatorsOnly>
          </div>
          <Refusal
            error={failure ?? (shown === "sequence" ? preview.error : null)}
            about={text}
            text={problem ?? meanwhile}
            hint={outcome}
          />
        </div>
        <Versions name={named} document={composed} onOpen={begin} />
      </div>
    </Card>
  );
}

/** Selects the refused line of a text, and scrolls to it. */
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

function describeSaved(stored: { readonly name: string; readonly version: number }): string {
  return fillText(TEXTS.saved, { name: stored.name, version: stored.version });
}
