/** Page of the documents of Sinew, with a search over all of them. */

import { TextInput } from "@mantine/core";
import { useMediaQuery } from "@mantine/hooks";
import { useEffect, useState } from "react";
import { Link, useParams } from "wouter";
import { Card } from "../../components/Card";
import { countThings, fillText } from "../../samples/texts";
import page from "../Page.module.css";
import styles from "./Docs.module.css";
import {
  addressed,
  DOCUMENTS,
  type Document,
  documentNamed,
  type Found,
  PURPOSES,
  purposeOf,
  search,
} from "./documents";
import { Markdown } from "./Markdown";
import { TEXTS } from "./texts";

const DECISIONS = "decisions/";
const MOST = 40;
const NARROW = "(max-width: 700px)";

const isDecision = ({ name }: Document) => name.startsWith(DECISIONS);

const GROUPS: readonly { title: string; documents: readonly Document[] }[] = [
  ...Object.entries(PURPOSES).map(([purpose, title]) => ({
    title,
    documents: DOCUMENTS.filter((one) => purposeOf(one) === purpose),
  })),
  { title: TEXTS.project, documents: DOCUMENTS.filter((one) => purposeOf(one) === null && !isDecision(one)) },
];

export default function DocsPage() {
  const { rest } = useParams<{ rest?: string }>();
  const { name, part } = addressed(rest ?? DOCUMENTS[0]?.name ?? "");
  const [words, setWords] = useState("");
  const shown = documentNamed(name);
  const found = search(words);
  return (
    <div className={page.page}>
      <h1 className={page.title}>{TEXTS.title}</h1>
      <div className={page.columns}>
        <Card title={TEXTS.documents}>
          <TextInput
            label={TEXTS.search}
            placeholder={TEXTS.searchHint}
            value={words}
            onChange={(event) => setWords(event.currentTarget.value)}
          />
          {words.trim() === "" ? (
            <Contents key={name} here={name} chosen={rest !== undefined} />
          ) : (
            <Results found={found} onFollowed={() => setWords("")} />
          )}
        </Card>
        {shown === undefined ? (
          <p className={page.empty}>{fillText(TEXTS.notFound, { name })}</p>
        ) : (
          <Reading document={shown} part={part} />
        )}
      </div>
    </div>
  );
}

/** Lists the documents; on narrow screens the list is closed while a document is open. */
function Contents({ here, chosen }: { here: string; chosen: boolean }) {
  const narrow = useMediaQuery(NARROW, false, { getInitialValueInEffect: false });
  return (
    <nav className={styles.contents} aria-label={TEXTS.documents}>
      <details open={!(narrow && chosen)}>
        <summary>{TEXTS.byPurpose}</summary>
        {GROUPS.map(({ title, documents }) => (
          <div key={title}>
            <h3>{title}</h3>
            <Titles of={documents} here={here} />
          </div>
        ))}
      </details>
      <details open={here.startsWith(DECISIONS)}>
        <summary>{TEXTS.decisions}</summary>
        <Titles of={DOCUMENTS.filter(isDecision)} here={here} />
      </details>
    </nav>
  );
}

function Titles({ of, here }: { of: readonly Document[]; here: string }) {
  return (
    <ul>
      {of.map(({ name, title }) => (
        <li key={name}>
          <Link href={`/docs/${name}`} aria-current={name === here ? "page" : undefined}>
            {title}
          </Link>
        </li>
      ))}
    </ul>
  );
}

function Results({ found, onFollowed }: { found: readonly Found[]; onFollowed: () => void }) {
  const sections = countThings(found.length, "section");
  return (
    <div className={styles.contents}>
      <output className={page.dim} aria-label={TEXTS.found}>
        {found.length > MOST ? fillText(TEXTS.foundFirst, { sections, shown: MOST }) : sections}
      </output>
      <ul>
        {found.slice(0, MOST).map(({ document, part, line }) => (
          <li key={`${document.name}/${part.id}`}>
            <Link href={`/docs/${document.name}/${part.id}`} onClick={onFollowed}>
              {part.title === document.title
                ? part.title
                : fillText(TEXTS.titleOfSection, { document: document.title, section: part.title })}
            </Link>
            <p className={styles.line}>{line}</p>
          </li>
        ))}
      </ul>
    </div>
  );
}

function Reading({ document, part }: { document: Document; part: string | null }) {
  useEffect(() => {
    const main = window.document.querySelector("main");
    const target = part === null ? null : window.document.getElementById(`part-${document.name}-${part}`);
    if (target === null) main?.scrollTo({ top: 0 });
    else target.scrollIntoView({ block: "start" });
  }, [document, part]);
  const [first, ...others] = document.parts;
  return (
    <article className={styles.reading} aria-label={document.title}>
      {[first, ...others].map((one) => one && <Section key={one.id} document={document} part={one} />)}
    </article>
  );
}

function Section({ document, part }: { document: Document; part: Document["parts"][number] }) {
  // the page contains the only h1
  const Heading = part.depth <= 1 ? "h2" : part.depth === 2 ? "h3" : "h4";
  return (
    <>
      <Heading id={`part-${document.name}-${part.id}`}>{part.title}</Heading>
      <Markdown of={document.name} tokens={part.tokens} />
    </>
  );
}
