//! Compares the chip with a PC, bit for bit, on every row of the catalogue of hard cases: each estimator
//! without the check, each estimator with it, and the reading of the rows. The program of `answers-on-chip`
//! runs on the emulated board. The test writes the rows to the board's memory and reads the answers from it.

use std::time::Duration;

use answers_on_chip::answers::{Estimators, MOST_WORDS, ROWS};
use answers_on_chip::mailbox::{self, Header};
use judges::hard_cases;
use slitrange::centre::Estimator;
use virtual_board::{Firmware, PIXELS, VirtualBoard};

struct Question {
    case: String,
    number: u64,
    header: Header,
    light: Vec<u16>,
}

/// The words of each estimator's answer, in the order of [`Estimator::ALL`].
type Answers = Vec<Vec<u32>>;

fn questions(one_in: usize) -> Vec<Question> {
    let rows = |case: hard_cases::RowCase| {
        (0..u64::from(ROWS)).map(move |number| {
            let row = case.row(number);
            let header = Header {
                pixels: row.light.len().try_into().expect("rows are short"),
                bits: row.geometry.bits,
                first: number == 0,
                shot_variance_per_count_q16: row.geometry.shot_variance_per_count_q16,
            };
            Question {
                case: case.name.clone(),
                number,
                header,
                light: row.light,
            }
        })
    };
    let cases = hard_cases::rows().into_iter().step_by(one_in);
    cases.flat_map(rows).collect()
}

fn on_this_pc(questions: &[Question]) -> Vec<Answers> {
    let mut estimators = Estimators::new();
    let answers = questions.iter().map(|Question { header, light, .. }| {
        if header.first {
            estimators.start(light.len(), header.bits, header.shot_variance_per_count_q16);
        }
        let mut answers = vec![vec![]; Estimator::ALL.len()];
        estimators.ask(&mut light.clone(), |estimator, word| {
            answers[estimator as usize].push(word)
        });
        answers
    });
    answers.collect()
}

struct Chip {
    board: VirtualBoard,
    asked: u64,
    rows: u64,
    answers: u64,
}

impl Chip {
    fn power_on() -> Self {
        let program = Firmware::build_package("answers-on-chip").expect("it builds");
        let board = VirtualBoard::power_on(&program, Box::new(|_| vec![0.0; PIXELS]));
        let mut board = board.expect("a board");
        // The program clears 64 KB of memory before it waits, one word in a few instructions.
        board.run_for(Duration::from_millis(2)).expect("a run");
        let address = |name| program.address_of(name).expect("the program has it");
        Self {
            board,
            asked: address("ASKED"),
            rows: address("ROWS"),
            answers: address("ANSWERS"),
        }
    }

    fn ask(&mut self, questions: &[Question]) -> Vec<u32> {
        let words = questions
            .iter()
            .flat_map(|it| mailbox::words(it.header, &it.light));
        let words: Vec<u32> = words.chain([0]).collect();
        assert!(words.len() <= mailbox::ROWS, "{} words", words.len());
        let asked = self.asked;
        self.board.write_words(self.rows, words).expect("RAM");
        self.board.write_words(asked, vec![1]).expect("RAM");
        // 10 s are 1.7e9 instructions: a row takes up to ten million, all estimators together.
        for _ in 0..10_000 {
            self.board.run_for(Duration::from_millis(1)).expect("a run");
            if self.board.read_word(asked).expect("RAM") == 0 {
                let count = self.board.read_word(self.answers).expect("RAM");
                let words = self.board.read_words(self.answers + 4, count as usize);
                return words.expect("the answers are in RAM");
            }
        }
        let log = self.board.take_log();
        panic!("no answer within 10 s; the log: {log:?}");
    }
}

/// Divides the rows into batches of whole cases. Each batch fits the program's memory, with its answers.
fn batches(mut questions: &[Question]) -> Vec<&[Question]> {
    let mut batches = vec![];
    while !questions.is_empty() {
        let (mut words, mut fit) = (1, 0);
        for case in questions.chunk_by(|_, next| !next.header.first) {
            let of_row = |row: &Question| 2 + row.light.len().div_ceil(2);
            words += case.iter().map(of_row).sum::<usize>();
            if words > mailbox::ROWS || (fit + case.len()) * MOST_WORDS >= mailbox::ANSWERS {
                break;
            }
            fit += case.len();
        }
        assert!(fit > 0, "{} does not fit", questions[0].case);
        let (batch, rest) = questions.split_at(fit);
        batches.push(batch);
        questions = rest;
    }
    batches
}

fn difference(questions: &[Question], chip: &[u32], pc: &[Answers]) -> Option<String> {
    let mut words = chip.iter().copied();
    for (question, answers) in questions.iter().zip(pc) {
        for (estimator, answer) in Estimator::ALL.iter().zip(answers) {
            let chip: Vec<u32> = words.by_ref().take(answer.len()).collect();
            if chip != *answer {
                let Question { case, number, .. } = question;
                let name = estimator.name();
                return Some(format!(
                    "{case}, row {number}, {name}: {chip:?} on the chip, {answer:?} on the PC"
                ));
            }
        }
    }
    let more = words.next();
    more.map(|word| format!("{word} on the chip, nothing on the PC"))
}

#[derive(Default)]
struct Compared<'a> {
    centres: usize,
    faults: usize,
    words: usize,
    clean: Option<&'a Question>,
}

fn compare<'a>(batches: &[&'a [Question]]) -> (Chip, Compared<'a>) {
    let mut chip = Chip::power_on();
    let mut compared = Compared::default();
    for batch in batches {
        let (words, pc) = (chip.ask(batch), on_this_pc(batch));
        assert_eq!(difference(batch, &words, &pc), None);
        compared.words += words.len();
        for (question, answers) in batch.iter().zip(pc) {
            // The first word is 0 for a centre, and the kind of a fault otherwise.
            let centres = answers.iter().filter(|it| it.first() == Some(&0));
            let found = centres.count();
            compared.centres += found;
            compared.faults += answers.len() - found;
            if question.header.first && found == Estimator::ALL.len() {
                compared.clean.get_or_insert(question);
            }
        }
    }
    (chip, compared)
}

#[test]
fn the_chip_and_a_pc_answer_the_same_to_hard_cases() {
    check_answers(4);
}

#[test]
#[ignore = "takes 30 CPU s; run by .ci/run"]
fn the_chip_and_a_pc_answer_the_same_to_every_hard_case() {
    check_answers(1);
}

/// Two boards share the rows, because one would keep one processor of the PC busy.
fn check_answers(one_in: usize) {
    let questions = questions(one_in);
    let batches = batches(&questions);
    let (one, other) = batches.split_at(batches.len() / 2);
    let ((mut chip, one), other) = std::thread::scope(|scope| {
        let other = scope.spawn(|| {
            let (chip, compared) = compare(other);
            chip.board.finish().expect("a clean run");
            compared
        });
        (compare(one), other.join().expect("the same answers"))
    });
    let (centres, faults) = (one.centres + other.centres, one.faults + other.faults);
    let (rows, words) = (questions.len(), one.words + other.words);
    println!("{rows} rows, {centres} centres and {faults} faults of the estimators alone");
    println!("{words} words are the same");
    let estimators = Estimator::ALL.len();
    assert!(rows >= 300 / one_in && centres >= 200 * estimators / one_in);
    assert!(faults >= 50 * estimators / one_in);

    // The comparison notices a change of one count in one pixel.
    let clean = one.clean.expect("a row whose spot all estimators find");
    let pixels = clean.light.iter().enumerate();
    let (top, _) = pixels.max_by_key(|(_, count)| **count).expect("pixels");
    let mut light = clean.light.clone();
    light[top] -= 1;
    let changed = [Question {
        case: clean.case.clone(),
        light,
        ..*clean
    }];
    let words = chip.ask(&changed);
    let of_the_other = on_this_pc(std::slice::from_ref(clean));
    println!(
        "one count less at the top: {}",
        difference(&changed, &words, &of_the_other).expect("other words")
    );
    assert_eq!(difference(&changed, &words, &on_this_pc(&changed)), None);
    chip.board.finish().expect("a clean run");
}
